//! The curriculum of a run: a fold over its events.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::event::{CurriculumEvent, GroupOutcome, Move, Proposal};
use super::explain::{Explanation, TaskStatus};
use super::mastery::{Mastery, Tracker};
use super::restore::{RestoreError, Snapshot};
use super::settings::{Settings, SettingsError};
use super::stored::StoredSettings;
use super::strategy::{self, Context, Job, Strategy};

/// A run's strategy, the mastery it has seen, its settings and the seq of its next event.
///
/// Every [`propose`](Self::propose), [`observe`](Self::observe) and [`change`](Self::change) takes one seq and is one
/// [`CurriculumEvent`]; stored in that order and given to [`replay`](Self::replay), they lead to the same curriculum.
/// Clone it before a transaction and put the clone back where the transaction fails.
pub struct Curriculum {
    strategy: Box<dyn Strategy>,
    mastery: Tracker,
    settings: Settings,
    run_seed: u64,
    next_seq: u64,
    /// Per task, the seq since which proposals are made by these settings. What was proposed before means something
    /// else by now and moves nothing.
    since: BTreeMap<String, u64>,
}

impl Curriculum {
    /// A curriculum at its start.
    ///
    /// # Errors
    /// Settings that cannot be.
    pub fn new(run_seed: u64, settings: Settings) -> Result<Self, SettingsError> {
        settings.validate()?;
        Ok(Self {
            strategy: strategy::fresh(&settings),
            mastery: Tracker::default(),
            settings,
            run_seed,
            next_seq: 0,
            since: BTreeMap::new(),
        })
    }

    /// The seq that the next event takes.
    #[must_use]
    pub const fn next_seq(&self) -> u64 {
        self.next_seq
    }

    /// The settings in force.
    #[must_use]
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What to face next, and the seq of this event.
    pub fn propose(&mut self) -> (u64, Proposal) {
        let ctx = Context { settings: &self.settings, run_seed: self.run_seed, seq: self.next_seq };
        let proposal = self.strategy.propose(&ctx);
        (self.step(), proposal)
    }

    /// Takes an outcome: the seq of this event and the moves it caused.
    pub fn observe(&mut self, outcome: &GroupOutcome) -> (u64, Vec<Move>) {
        let moves = if self.concerns(outcome) {
            self.mastery.observe(outcome);
            let ctx = Context { settings: &self.settings, run_seed: self.run_seed, seq: self.next_seq };
            self.strategy.observe(outcome, &ctx)
        } else {
            Vec::new()
        };
        (self.step(), moves)
    }

    /// Puts other settings in force: the seq of this event. A task keeps its level and mastery unless it is new or its
    /// table or default params changed; with another strategy every task starts afresh and keeps its mastery.
    ///
    /// # Errors
    /// Settings that cannot be; nothing has changed then.
    pub fn change(&mut self, settings: Settings) -> Result<u64, SettingsError> {
        settings.validate()?;
        let old = std::mem::replace(&mut self.settings, settings);
        let other_strategy = old.strategy != self.settings.strategy;
        let other_course: Vec<&str> = (self.settings.tasks.iter())
            .filter(|plan| !old.task(&plan.task).is_some_and(|before| before.same_course(plan)))
            .map(|plan| plan.task.as_str())
            .collect();
        let gone = old.tasks.iter().map(|plan| plan.task.as_str());
        for task in gone.filter(|task| self.settings.task(task).is_none()).chain(other_course.iter().copied())
        {
            self.mastery.forget(task);
        }
        self.since.retain(|task, _| self.settings.task(task).is_some());
        // Under other settings of the strategy what was proposed before means something else, too.
        let other_tuning = old.tuning != self.settings.tuning;
        for plan in &self.settings.tasks {
            if other_strategy || other_tuning || other_course.contains(&plan.task.as_str()) {
                self.since.insert(plan.task.clone(), self.next_seq);
            }
        }
        if other_strategy {
            self.strategy = strategy::fresh(&self.settings);
        } else {
            let ctx = Context { settings: &self.settings, run_seed: self.run_seed, seq: self.next_seq };
            self.strategy.adopt(&other_course, &ctx);
        }
        Ok(self.step())
    }

    /// Whether a proposal made at `seq` is still what the curriculum wants: a move or a change of settings since makes
    /// it stale. Its outcome may be reported all the same.
    #[must_use]
    pub fn is_current(&self, seq: u64, proposal: &Proposal) -> bool {
        self.made_by_these_settings(&proposal.task, seq)
            && proposal.epoch == self.strategy.epoch(&proposal.task)
    }

    /// Takes a stored event, as it was taken when it was stored.
    ///
    /// # Errors
    /// A seq out of order, a stored proposal that is not what is proposed again, settings that cannot be. The
    /// curriculum must then be dropped.
    pub fn replay(&mut self, seq: u64, event: &CurriculumEvent) -> Result<(), RestoreError> {
        if seq != self.next_seq {
            return Err(RestoreError::OutOfOrder { found: seq, wanted: self.next_seq });
        }
        match event {
            CurriculumEvent::Proposed(stored) => {
                let (_, proposed) = self.propose();
                if !proposed.same_decision(stored) {
                    let (stored, proposed) = (Box::new(stored.clone()), Box::new(proposed));
                    return Err(RestoreError::OtherProposal { seq, stored, proposed });
                }
            }
            CurriculumEvent::Outcome(outcome) => {
                self.observe(outcome);
            }
            CurriculumEvent::Settings(stored) => {
                self.change(Settings::try_from(stored.clone())?)?;
            }
        }
        Ok(())
    }

    /// Everything but the run's seed.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            strategy: self.settings.strategy,
            version: self.strategy.version(),
            state: self.strategy.snapshot(),
            settings: StoredSettings::from(self.settings.clone()),
            mastery: self.mastery.store(),
            since: self.since.clone(),
            next_seq: self.next_seq,
        }
    }

    /// A curriculum as it was when the snapshot was taken; replay what came after it.
    ///
    /// # Errors
    /// A snapshot of another version of its strategy, or one that cannot be read.
    pub fn restore(run_seed: u64, snapshot: Snapshot) -> Result<Self, RestoreError> {
        let settings = Settings::try_from(snapshot.settings)?;
        if snapshot.strategy != settings.strategy {
            let reason = format!("the settings ask for {}", settings.strategy);
            return Err(RestoreError::State { strategy: snapshot.strategy, reason });
        }
        Ok(Self {
            strategy: strategy::restored(&settings, snapshot.version, &snapshot.state)?,
            mastery: Tracker::restore(snapshot.mastery),
            settings,
            run_seed,
            next_seq: snapshot.next_seq,
            since: snapshot.since,
        })
    }

    /// The seqs of proposals whose scenarios may be wanted again.
    #[must_use]
    pub fn held(&self) -> Vec<u64> {
        self.strategy.held()
    }

    /// Work that the strategy will need, each piece told of once: done before, it takes no time when it is due.
    #[must_use]
    pub fn jobs(&self) -> Vec<Arc<dyn Job>> {
        self.strategy.jobs()
    }

    /// What the agent has mastered, per task and level with evidence.
    #[must_use]
    pub fn mastery(&self) -> Vec<Mastery> {
        self.mastery.mastery(&self.settings)
    }

    /// Where each task stands.
    #[must_use]
    pub fn status(&self) -> Vec<TaskStatus> {
        self.strategy.status(&self.settings)
    }

    /// For people: rules, and what moved on what evidence.
    #[must_use]
    pub fn explain(&self) -> Explanation {
        self.strategy.explain(&self.settings)
    }

    /// Whether an outcome is one of a task, table and strategy in force.
    fn concerns(&self, outcome: &GroupOutcome) -> bool {
        let Some(plan) = self.settings.task(&outcome.task) else { return false };
        outcome.level.is_none_or(|level| level <= plan.top())
            && self.made_by_these_settings(&outcome.task, outcome.proposal)
    }

    fn made_by_these_settings(&self, task: &str, seq: u64) -> bool {
        self.settings.task(task).is_some() && self.since.get(task).is_none_or(|&since| seq >= since)
    }

    const fn step(&mut self) -> u64 {
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
