//! The curriculum of a run: a fold over its events.

use std::collections::BTreeMap;
use std::sync::Arc;

use env_core::KeyedRng;

use crate::core::event::CurriculumEvent;
use crate::core::evidence::level_move::LevelMove;
use crate::core::explanation::{Explanation, TaskStatus};
use crate::core::mastery::{Mastery, MasteryTracker};
use crate::core::outcome::GroupOutcome;
use crate::core::proposal::Proposal;
use crate::core::rung_tracker::RungTracker;
use crate::core::sampler_state::SamplerState;
use crate::core::settings::{Settings, SettingsError, StoredSettings, TaskPlan};
use crate::core::slot::{Slot, StalledSlot};
use crate::core::snapshot::{RestoreError, Snapshot};
use crate::core::strategy::{BackgroundJob, Strategy, StrategyContext};
use crate::strategies;

/// Largest seq, which is stored as a signed integer.
const MAX_SEQ: u64 = i64::MAX as u64;

/// Strategy, mastery and settings of a run, and the seq of its next event.
///
/// Each call of [`propose`](Self::propose), [`open_slots`](Self::open_slots), [`withdraw_slots`](Self::withdraw_slots),
/// [`observe`](Self::observe), [`change_settings`](Self::change_settings) and
/// [`restart_evidence`](Self::restart_evidence) takes one seq and is one [`CurriculumEvent`]. The same events, given in
/// that order to [`replay_event`](Self::replay_event), lead to the same curriculum. To undo the calls of a transaction
/// that may fail, clone the curriculum before it and restore the clone.
pub struct Curriculum {
    strategy: Box<dyn Strategy>,
    mastery: MasteryTracker,
    rungs: RungTracker,
    settings: Settings,
    run_seed: u64,
    next_seq: u64,
    /// Per task, the seq from which proposals follow these settings. Outcomes of earlier proposals belong to another
    /// meaning of the task and move nothing.
    since: BTreeMap<String, u64>,
}

/// Proposal with the seq of its event.
#[derive(Debug, Clone, PartialEq)]
pub struct SequencedProposal {
    /// Seq of the event.
    pub seq: u64,
    /// Proposal that the event made.
    pub proposal: Proposal,
}

/// Effect of an outcome on a curriculum.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedOutcome {
    /// Seq of the event.
    pub seq: u64,
    /// Level moves that the outcome caused.
    pub moves: Vec<LevelMove>,
}

impl Curriculum {
    /// A curriculum before its first event.
    ///
    /// # Errors
    /// Returns the error of [`Settings::validate`] if the settings are invalid.
    pub fn new(run_seed: u64, settings: Settings) -> Result<Self, SettingsError> {
        settings.validate()?;
        Ok(Self {
            strategy: strategies::create(&settings),
            mastery: MasteryTracker::default(),
            rungs: RungTracker::default(),
            settings,
            run_seed,
            next_seq: 0,
            since: BTreeMap::new(),
        })
    }

    /// Restores a curriculum from a snapshot. Events after the snapshot must be replayed next.
    ///
    /// # Errors
    /// Returns [`RestoreError::Settings`] if the stored settings are invalid, [`RestoreError::OtherVersion`] if another
    /// version of the strategy wrote the snapshot, and [`RestoreError::State`] if the strategy cannot read its state.
    pub fn restore(run_seed: u64, snapshot: Snapshot) -> Result<Self, RestoreError> {
        let settings = Settings::try_from(snapshot.settings)?;
        if snapshot.strategy != settings.strategy {
            let reason = format!("the settings ask for {}", settings.strategy);
            return Err(RestoreError::State { strategy: snapshot.strategy, reason });
        }
        if snapshot.next_seq > MAX_SEQ {
            let reason = format!("the next seq must be at most {MAX_SEQ}, got {}", snapshot.next_seq);
            return Err(RestoreError::State { strategy: snapshot.strategy, reason });
        }
        Ok(Self {
            strategy: strategies::restore(&settings, snapshot.version, &snapshot.state)?,
            mastery: MasteryTracker::restore(snapshot.mastery),
            rungs: snapshot.rungs,
            settings,
            run_seed,
            next_seq: snapshot.next_seq,
            since: snapshot.since,
        })
    }

    /// Complete state of the curriculum, except for the run seed.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            strategy: self.settings.strategy,
            version: self.strategy.version(),
            state: self.strategy.snapshot(),
            settings: StoredSettings::from(self.settings.clone()),
            mastery: self.mastery.store(),
            rungs: self.rungs.clone(),
            since: self.since.clone(),
            next_seq: self.next_seq,
        }
    }

    /// Makes the next proposal.
    pub fn propose(&mut self) -> SequencedProposal {
        let ctx = StrategyContext { settings: &self.settings, run_seed: self.run_seed, seq: self.next_seq };
        let proposal = self.strategy.propose(&ctx);
        self.rungs.record_draw(&proposal);
        SequencedProposal { seq: self.take_seq(), proposal }
    }

    /// Takes note of slots: groups whose results are evidence of mastery. Their trainer receives the scenarios after
    /// this. Returns the seq of this event.
    pub fn open_slots(&mut self, slots: &[Slot]) -> u64 {
        for slot in slots {
            if self.is_relevant(&slot.task, slot.level, slot.proposal) {
                self.mastery.open(slot);
                let ctx =
                    StrategyContext { settings: &self.settings, run_seed: self.run_seed, seq: self.next_seq };
                self.strategy.open_slot(slot, &ctx);
            }
        }
        self.take_seq()
    }

    /// Drops open slots that will have no value, because the server lost their groups before a trainer saw them.
    pub fn withdraw_slots(&mut self, slots: &[Slot]) -> ObservedOutcome {
        let mut moves = Vec::new();
        for slot in slots {
            self.mastery.withdraw(slot);
            let ctx =
                StrategyContext { settings: &self.settings, run_seed: self.run_seed, seq: self.next_seq };
            moves.extend(self.strategy.withdraw_slot(slot, &ctx));
        }
        ObservedOutcome { seq: self.take_seq(), moves }
    }

    /// Takes the outcome of a group into account. An outcome with evidence sets the value of its slot; a slot keeps its
    /// first value.
    pub fn observe(&mut self, outcome: &GroupOutcome) -> ObservedOutcome {
        // A slot keeps its place in the mastery under another strategy: a trainer cannot lose it by a change of the settings.
        self.mastery.observe(outcome);
        let moves = if self.is_relevant(&outcome.task, outcome.level, outcome.proposal) {
            self.rungs.observe(outcome);
            let ctx =
                StrategyContext { settings: &self.settings, run_seed: self.run_seed, seq: self.next_seq };
            self.strategy.observe(outcome, &ctx)
        } else {
            Vec::new()
        };
        ObservedOutcome { seq: self.take_seq(), moves }
    }

    /// Drops all evidence, because results have another meaning from now on: the rule of success or the leases that
    /// count changed. Levels stay. Outcomes of earlier proposals change nothing any more. Returns the seq of this event.
    pub fn restart_evidence(&mut self) -> u64 {
        let tasks: Vec<String> = self.settings.tasks.iter().map(|plan| plan.task.clone()).collect();
        for task in &tasks {
            self.mastery.forget(task);
            self.rungs.forget(task);
            self.close_epoch(task);
        }
        self.take_seq()
    }

    /// Lets proposals of a task count from this event on, and slots of later leases move its level. Mastery keeps its slots.
    fn close_epoch(&mut self, task: &str) {
        self.since.insert(task.to_owned(), self.next_seq);
        let ctx = StrategyContext { settings: &self.settings, run_seed: self.run_seed, seq: self.next_seq };
        self.strategy.close_epoch(task, &ctx);
    }

    /// Puts other settings in force and returns the seq of this event. A task keeps its level and mastery unless it is
    /// new, or its level table, default params or physics changed. Under another strategy every task restarts and
    /// keeps its mastery.
    ///
    /// # Errors
    /// Returns the error of [`Settings::validate`] if the settings are invalid; nothing changes then.
    pub fn change_settings(&mut self, settings: Settings) -> Result<u64, SettingsError> {
        settings.validate()?;
        let old = std::mem::replace(&mut self.settings, settings);
        let restarted: Vec<&str> = (self.settings.tasks.iter())
            .filter(|plan| !old.task(&plan.task).is_some_and(|before| before.has_same_levels(plan)))
            .map(|plan| plan.task.as_str())
            .collect();
        let old_tasks = old.tasks.iter().map(|plan| plan.task.as_str());
        let removed = old_tasks.filter(|task| self.settings.task(task).is_none());
        for task in removed.chain(restarted.iter().copied()) {
            self.mastery.forget(task);
            self.rungs.forget(task);
        }
        self.since.retain(|task, _| self.settings.task(task).is_some());
        let is_other_strategy = old.strategy != self.settings.strategy;
        if is_other_strategy {
            self.strategy = strategies::create(&self.settings);
        } else {
            let ctx =
                StrategyContext { settings: &self.settings, run_seed: self.run_seed, seq: self.next_seq };
            self.strategy.change_settings(&restarted, &ctx);
        }
        // Under other hyperparameters, earlier proposals have another meaning, too.
        let all_changed = is_other_strategy || old.hyperparameters != self.settings.hyperparameters;
        let tasks = self.settings.tasks.iter().map(|plan| plan.task.clone());
        let changed: Vec<String> =
            tasks.filter(|task| all_changed || restarted.contains(&task.as_str())).collect();
        changed.iter().for_each(|task| self.close_epoch(task));
        Ok(self.take_seq())
    }

    /// Applies a stored event, and makes proposals again. One that needs a background job that has not run stands.
    ///
    /// # Errors
    /// Returns [`RestoreError`] if `seq` is not the next one, if a proposal differs, or if settings are invalid. The
    /// curriculum must then be dropped.
    pub fn replay_event(&mut self, seq: u64, event: &CurriculumEvent) -> Result<(), RestoreError> {
        if seq != self.next_seq {
            return Err(RestoreError::OutOfOrder { found: seq, wanted: self.next_seq });
        }
        match event {
            CurriculumEvent::Proposed(stored) => {
                let ctx =
                    StrategyContext { settings: &self.settings, run_seed: self.run_seed, seq: self.next_seq };
                let proposed = self.strategy.propose_again(&ctx);
                if let Some(proposed) = proposed.filter(|proposed| !proposed.is_same_decision(stored)) {
                    let (stored, proposed) = (Box::new(stored.clone()), Box::new(proposed));
                    return Err(RestoreError::OtherProposal { seq, stored, proposed });
                }
                self.rungs.record_draw(stored);
                self.take_seq();
            }
            CurriculumEvent::Opened(slots) => {
                self.open_slots(slots);
            }
            CurriculumEvent::Withdrawn(slots) => {
                self.withdraw_slots(slots);
            }
            CurriculumEvent::Outcome(outcome) => {
                self.observe(outcome);
            }
            CurriculumEvent::Settings(stored) => {
                self.change_settings(Settings::try_from(stored.clone())?)?;
            }
            CurriculumEvent::EvidenceRestarted => {
                self.restart_evidence();
            }
        }
        Ok(())
    }

    /// Seq that the next event takes.
    #[must_use]
    pub const fn next_seq(&self) -> u64 {
        self.next_seq
    }

    /// Settings that are in force.
    #[must_use]
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// True if a proposal made at `seq` is still valid. A later move or change of settings makes it stale; its outcome
    /// may be reported all the same.
    #[must_use]
    pub fn is_current(&self, seq: u64, proposal: &Proposal) -> bool {
        self.follows_settings(&proposal.task, seq) && proposal.epoch == self.strategy.epoch(&proposal.task)
    }

    /// Seqs of the proposals whose scenarios may be proposed again and must be kept.
    #[must_use]
    pub fn retained_proposals(&self) -> Vec<u64> {
        self.strategy.retained_proposals()
    }

    /// Expensive work whose result is due later. Each job is returned once; running it early saves time, and skipping
    /// it changes no result.
    #[must_use]
    pub fn take_background_jobs(&self) -> Vec<Arc<dyn BackgroundJob>> {
        self.strategy.take_background_jobs()
    }

    /// Mastery of every task and level with evidence.
    #[must_use]
    pub fn mastery(&self) -> Vec<Mastery> {
        self.mastery.mastery(&self.settings)
    }

    /// Sampler of each task: its rungs, the latest draws and successes there, and the probabilities of the next draw.
    #[must_use]
    pub fn samplers(&self) -> Vec<SamplerState> {
        let ctx = StrategyContext { settings: &self.settings, run_seed: self.run_seed, seq: self.next_seq };
        let explanation = self.explain();
        let sampler = |plan: &TaskPlan| {
            let explained = explanation.tasks.iter().find(|task| task.task == plan.task);
            let state = explained.map_or("", |task| &task.current_state);
            let outlook = self.strategy.sampler(plan, &ctx);
            SamplerState::new(plan, self.settings.strategy, outlook, state, self.rungs.task(&plan.task))
        };
        self.settings.tasks.iter().map(sampler).collect()
    }

    /// Slots for which at least `min_later` results of later leases wait, at most one for each task and level.
    #[must_use]
    pub fn stalled_slots(&self, min_later: u32) -> Vec<StalledSlot> {
        self.mastery.stalled(min_later).collect()
    }

    /// Current state of each task.
    #[must_use]
    pub fn status(&self) -> Vec<TaskStatus> {
        let mut tasks = self.strategy.status(&self.settings);
        for status in &mut tasks {
            status.warnings = self.warnings(&status.task);
        }
        tasks
    }

    /// Rung that the strategy draws for a task; `None` for an unknown task, and under a strategy that samples no rungs. The
    /// curriculum does not change.
    pub fn sample_rung(&self, task: &str, rng: &mut KeyedRng) -> Option<u32> {
        self.strategy.sample_rung(self.settings.task(task)?, &self.settings, rng)
    }

    /// Problems of a task that the user should know about, one sentence each.
    #[must_use]
    pub fn warnings(&self, task: &str) -> Vec<String> {
        let mut warnings = self.strategy.warnings(task, &self.settings);
        warnings.extend(self.mastery.missing_warning(task));
        warnings
    }

    /// Number of moves of a task so far, steps of placement and restarts of its evidence included.
    #[must_use]
    pub fn epoch(&self, task: &str) -> u32 {
        self.strategy.epoch(task)
    }

    /// Rules, current state and last moves as text.
    #[must_use]
    pub fn explain(&self) -> Explanation {
        self.strategy.explain(&self.settings)
    }

    /// True if a proposal's result belongs to a task, level and strategy in force.
    fn is_relevant(&self, task: &str, level: Option<u32>, proposal: u64) -> bool {
        let Some(plan) = self.settings.task(task) else { return false };
        level.is_none_or(|level| level <= plan.hardest_level()) && self.follows_settings(task, proposal)
    }

    /// True if a proposal of the task made at `seq` follows the settings in force.
    fn follows_settings(&self, task: &str, seq: u64) -> bool {
        self.settings.task(task).is_some() && self.since.get(task).is_none_or(|&since| seq >= since)
    }

    const fn take_seq(&mut self) -> u64 {
        let seq = self.next_seq;
        self.next_seq += 1;
        seq
    }
}

impl Clone for Curriculum {
    fn clone(&self) -> Self {
        Self {
            strategy: self.strategy.boxed_clone(),
            mastery: self.mastery.clone(),
            rungs: self.rungs.clone(),
            settings: self.settings.clone(),
            run_seed: self.run_seed,
            next_seq: self.next_seq,
            since: self.since.clone(),
        }
    }
}

impl std::fmt::Debug for Curriculum {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Curriculum")
            .field("run_seed", &self.run_seed)
            .field("snapshot", &self.snapshot())
            .finish()
    }
}
