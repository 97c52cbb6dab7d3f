//! A curriculum, a trainer and a learner against each other.

use std::collections::{BTreeMap, VecDeque};

use env_core::KeyedRng;
use env_core::keyed_rng::RngPurpose;

use super::learner::{GroupResult, Learner, UNTRAINED_ABILITY};
use super::scenario::{Selection, SyntheticScenario};
use super::trainer::{LEASE_GROUPS, TrainerKind};
use crate::core::rungs::RungScale;
use crate::{
    Curriculum, EpisodeTally, GroupOutcome, LearningSignals, LevelMove, ObservedOutcome, Proposal,
    ProposalRole, ScenarioSource, SequencedProposal, Settings, SettingsError, Slot, SuccessInterval,
    TaskPlan, TaskStatus, difficulty,
};

/// Score of an episode that succeeds.
const SUCCESS_SCORE: f64 = 0.9;
/// Score of an episode that fails.
const FAILURE_SCORE: f64 = 0.2;

/// Number of steps of every episode.
const EPISODE_STEPS: u64 = 50;

/// Number of later results after which a slot without a result is missing. The simulation has no clock: the time of a
/// lease is over by then.
const LATER_RESULTS: u32 = 64;

/// Inputs of a simulation.
#[derive(Debug, Clone)]
pub struct SimulationPlan {
    /// Settings of the curriculum.
    pub settings: Settings,
    /// Trainer that reports the results.
    pub trainer: TrainerKind,
    /// Number of episodes in total.
    pub episodes: u64,
    /// Number of episodes of a group.
    pub group_size: u32,
    /// Number of proposals that wait while a group is run. Those that a move makes stale are dropped, as the service
    /// does.
    pub queue_length: usize,
    /// Seed of all random draws.
    pub seed: u64,
}

/// Group of a simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedGroup {
    /// Number of episodes before this group.
    pub episodes_before: u64,
    /// Index of its task in the settings.
    pub task_index: usize,
    /// Role of its proposal.
    pub role: ProposalRole,
    /// Difficulty of its params, in rows of the level table.
    pub difficulty: f64,
    /// Ability of the learner before the group, in rows.
    pub ability: f64,
    /// True if its scenario was contested.
    pub contested: bool,
    /// True if the learner learnt from it.
    pub train: bool,
    /// True if the task's first level was set.
    pub placed: bool,
    /// True if the group was evidence of mastery.
    pub is_slot: bool,
    /// Number of episodes that finished, reported or not.
    pub finished: u32,
    /// Number of finished episodes that succeeded.
    pub successes: u32,
}

impl SimulatedGroup {
    /// True if several episodes finished, and all with the same result.
    #[must_use]
    pub const fn has_zero_variance(&self) -> bool {
        self.finished > 1 && (self.successes == 0 || self.successes == self.finished)
    }
}

/// Level move of a simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedMove {
    /// Number of episodes before the group that caused the move.
    pub episodes_before: u64,
    /// Move of the task's level.
    pub level_move: LevelMove,
}

/// Complete record of a simulation.
#[derive(Debug)]
pub struct SimulationTrace {
    /// Groups in the order of their proposals.
    pub groups: Vec<SimulatedGroup>,
    /// Level moves in the order of their groups.
    pub moves: Vec<SimulatedMove>,
    /// State of each task at the end.
    pub status: Vec<TaskStatus>,
    /// The learner at the end.
    pub learner: Learner,
    /// The curriculum at the end.
    pub curriculum: Curriculum,
}

/// Runs a curriculum against a learner until all episodes of the plan are done.
///
/// # Errors
/// Returns an error that names the field if the settings are invalid.
pub fn simulate(plan: &SimulationPlan, learner: Learner) -> Result<SimulationTrace, SettingsError> {
    let mut simulator = Simulator {
        plan,
        learner,
        curriculum: Curriculum::new(plan.seed, plan.settings.clone())?,
        scenarios: BTreeMap::new(),
        queue: VecDeque::new(),
        withheld: BTreeMap::new(),
        leases: 0,
        placed: Vec::new(),
        rng: KeyedRng::new(RngPurpose::Simulation, plan.seed, u64::MAX),
        groups: Vec::new(),
        moves: Vec::new(),
    };
    let mut episodes = 0;
    while episodes < plan.episodes {
        let begun = simulator.run_lease(episodes);
        episodes += begun as u64 * u64::from(plan.group_size);
    }
    let Simulator { curriculum, learner, groups, moves, .. } = simulator;
    Ok(SimulationTrace { groups, moves, status: curriculum.status(), learner, curriculum })
}

/// Group of a lease, and its scenario.
struct LeasedGroup {
    seq: u64,
    proposal: Proposal,
    scenario: SyntheticScenario,
    /// Slot of the group, if it is evidence.
    slot: Option<Slot>,
}

struct Simulator<'a> {
    plan: &'a SimulationPlan,
    learner: Learner,
    curriculum: Curriculum,
    /// Scenarios that may be repeated, by the seq of the proposal that made them.
    scenarios: BTreeMap<u64, SyntheticScenario>,
    /// Proposals that wait to be leased.
    queue: VecDeque<SequencedProposal>,
    /// Groups that the trainer keeps leased, by the seq of their proposal.
    withheld: BTreeMap<u64, LeasedGroup>,
    /// Number of leases so far.
    leases: u64,
    /// For each task, true if its first level was set before the current lease.
    placed: Vec<bool>,
    rng: KeyedRng,
    groups: Vec<SimulatedGroup>,
    moves: Vec<SimulatedMove>,
}

impl Simulator<'_> {
    /// Leases groups, rolls them out and reports what the trainer reports. Returns the number of groups that it began.
    fn run_lease(&mut self, episodes_before: u64) -> usize {
        self.leases += 1;
        self.placed = self.curriculum.status().iter().map(|status| status.placement_done).collect();
        let mut groups = self.lease_groups();
        let begun = self.plan.trainer.begun_groups(groups.len(), &mut self.rng);
        if self.plan.trainer.returns_undisclosed() {
            let returned = groups.split_off(begun);
            let proposals = returned.into_iter().map(|group| (group.seq, group.proposal));
            for (seq, proposal) in proposals.rev() {
                self.queue.push_front(SequencedProposal { seq, proposal });
            }
        }
        let slots: Vec<Slot> = groups.iter().filter_map(|group| group.slot.clone()).collect();
        if !slots.is_empty() {
            self.curriculum.open_slots(&slots);
        }
        let size = u64::from(self.plan.group_size);
        let mut results: Vec<GroupResult> = (0..)
            .zip(&groups[..begun])
            .map(|(at, group)| self.roll_out(episodes_before + at * size, group))
            .collect();
        results.resize(groups.len(), GroupResult::NONE);
        let audited: Vec<usize> = (0..groups.len()).filter(|&at| groups[at].slot.is_some()).collect();
        let reports = self.plan.trainer.report(&results, &audited);
        let mut has_moved = false;
        for (group, report) in groups.into_iter().zip(reports) {
            match report {
                Some(result) => has_moved |= self.observe(episodes_before, &group, result),
                None => {
                    self.withheld.insert(group.seq, group);
                }
            }
        }
        has_moved |= self.close_stalled(episodes_before);
        if has_moved {
            let Self { curriculum, queue, .. } = self;
            queue.retain(|next| curriculum.is_current(next.seq, &next.proposal));
        }
        begun.max(1)
    }

    /// Takes the next proposals, and those of their scenarios that are slots.
    fn lease_groups(&mut self) -> Vec<LeasedGroup> {
        while self.queue.len() < LEASE_GROUPS + self.plan.queue_length {
            self.queue.push_back(self.curriculum.propose());
        }
        let proposals: Vec<SequencedProposal> = self.queue.drain(..LEASE_GROUPS).collect();
        let group = |SequencedProposal { seq, proposal }| {
            let plan = self.plan.settings.task(&proposal.task);
            let difficulty = plan.map_or(0.0, |plan| simulated_difficulty(plan, &proposal));
            let scenario = self.scenario(seq, &proposal, difficulty);
            let can_show_mastery = proposal.source.is_fresh() && proposal.has_full_start();
            let slot = (scenario.contested && can_show_mastery).then(|| Slot {
                proposal: seq,
                group: 0,
                lease: self.leases,
                task: proposal.task.clone(),
                level: proposal.level,
                epoch: proposal.epoch,
                role: proposal.role,
            });
            LeasedGroup { seq, proposal, scenario, slot }
        };
        proposals.into_iter().map(group).collect()
    }

    /// Rolls a group out.
    fn roll_out(&mut self, episodes_before: u64, group: &LeasedGroup) -> GroupResult {
        let LeasedGroup { proposal, scenario, .. } = group;
        let tasks = &self.plan.settings.tasks;
        let task_index = tasks.iter().position(|task| task.task == proposal.task).unwrap_or_default();
        let ability = self.learner.ability(&proposal.task);
        let size = self.plan.group_size;
        let result = self.learner.run_group(&proposal.task, scenario, size, proposal.train, &mut self.rng);
        let placed = self.placed.get(task_index).copied().unwrap_or(true);
        self.groups.push(SimulatedGroup {
            episodes_before,
            task_index,
            role: proposal.role,
            difficulty: scenario.difficulty,
            ability,
            contested: scenario.contested,
            train: proposal.train,
            placed,
            is_slot: group.slot.is_some(),
            finished: result.finished,
            successes: result.successes,
        });
        result
    }

    /// Passes a reported group to the curriculum; true if it caused a move.
    fn observe(&mut self, episodes_before: u64, group: &LeasedGroup, result: GroupResult) -> bool {
        let LeasedGroup { seq, proposal, scenario, slot } = group;
        let mut outcome = group_outcome(*seq, proposal, scenario, result);
        outcome.evidence = slot.as_ref().map(|_| {
            let GroupResult { finished, successes, .. } = result;
            let size = self.plan.group_size;
            SuccessInterval::of_episodes(EpisodeTally { size, finished, successes, abandoned: 0 })
        });
        let ObservedOutcome { moves, .. } = self.curriculum.observe(&outcome);
        self.curriculum.take_background_jobs().iter().for_each(|job| job.run());
        let has_moved = !moves.is_empty();
        let moves = moves.into_iter().map(|level_move| SimulatedMove { episodes_before, level_move });
        self.moves.extend(moves);
        has_moved
    }

    /// Ends the withheld groups for which too many later results wait: they have no result. True if this caused a move.
    fn close_stalled(&mut self, episodes_before: u64) -> bool {
        let mut has_moved = false;
        loop {
            let overdue =
                self.curriculum.stalled_slots(LATER_RESULTS).into_iter().map(|slot| slot.key.proposal);
            let groups: Vec<LeasedGroup> = overdue.filter_map(|seq| self.withheld.remove(&seq)).collect();
            if groups.is_empty() {
                return has_moved;
            }
            for group in groups {
                has_moved |= self.observe(episodes_before, &group, GroupResult::NONE);
            }
        }
    }

    /// Scenario of a proposal, fresh or from an earlier one.
    fn scenario(&mut self, seq: u64, proposal: &Proposal, difficulty: f64) -> SyntheticScenario {
        let seed = self.plan.seed;
        let earlier = |of: u64| self.scenarios.get(&of).copied();
        let draw = || SyntheticScenario::draw(seed, seq, proposal, difficulty);
        let scenario = match proposal.source {
            ScenarioSource::Fresh => draw(),
            ScenarioSource::Replay { of } => earlier(of).unwrap_or_else(draw),
            ScenarioSource::Edited { of } => earlier(of).unwrap_or_else(draw).edit(seed, seq),
            ScenarioSource::Chosen { among, base, panel } => {
                let selection = Selection { among, base, panel };
                SyntheticScenario::choose(seed, seq, proposal, difficulty, selection)
            }
        };
        if self.plan.settings.strategy.replays_scenarios() {
            self.scenarios.insert(seq, scenario);
        }
        scenario
    }
}

/// Difficulty of a proposal, in rows. Start rungs lie between the row of an untrained learner and that of the params.
#[must_use]
pub fn simulated_difficulty(plan: &TaskPlan, proposal: &Proposal) -> f64 {
    let full = difficulty(plan, &proposal.params);
    let top = RungScale::new(plan).top();
    match proposal.start_rung {
        Some(rung) => {
            UNTRAINED_ABILITY + (full - UNTRAINED_ABILITY) * f64::from(rung) / f64::from(top.max(1))
        }
        None => full,
    }
}

/// Outcome of a group that is no evidence, as the service would report it to the curriculum.
#[must_use]
pub fn group_outcome(
    seq: u64,
    proposal: &Proposal,
    scenario: &SyntheticScenario,
    result: GroupResult,
) -> GroupOutcome {
    let GroupResult { finished, successes, .. } = result;
    let success_rate = if finished > 0 { f64::from(successes) / f64::from(finished) } else { 0.0 };
    GroupOutcome {
        is_designed: false,
        proposal: seq,
        group: 0,
        task: proposal.task.clone(),
        level: proposal.level,
        start_rung: proposal.start_rung,
        chain: proposal.chain,
        epoch: proposal.epoch,
        role: proposal.role,
        contested: scenario.contested,
        finished,
        successes,
        steps: EPISODE_STEPS * u64::from(finished),
        evidence: None,
        usable: finished > 0,
        mean_score: FAILURE_SCORE + (SUCCESS_SCORE - FAILURE_SCORE) * success_rate,
        mean_skill: None,
        source: proposal.source.clone(),
        params: if proposal.level.is_none() { proposal.params.clone() } else { Vec::new() },
        signals: LearningSignals {
            // In an unsolvable scenario the planner fails, too.
            regret: (finished > 0).then_some(if scenario.solvable { 1.0 - success_rate } else { 0.0 }),
            panel: Some(scenario.panel),
            ..LearningSignals::default()
        },
    }
}
