//! A curriculum and a learner against each other.

use std::collections::{BTreeMap, VecDeque};

use env_core::KeyedRng;
use env_core::keyed_rng::RngPurpose;

use super::learner::{GroupResult, Learner};
use super::scenario::{Selection, SyntheticScenario};
use crate::{
    Curriculum, GroupOutcome, LearningSignals, LevelMove, ObservedOutcome, Proposal, ProposalRole,
    ScenarioSource, SequencedProposal, Settings, SettingsError, TaskStatus, difficulty,
};

/// Score of an episode that succeeds.
const SUCCESS_SCORE: f64 = 0.9;
/// Score of an episode that fails.
const FAILURE_SCORE: f64 = 0.2;

/// Inputs of a simulation.
#[derive(Debug, Clone)]
pub struct SimulationPlan {
    /// Settings of the curriculum.
    pub settings: Settings,
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
    /// Number of episodes reported as finished.
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
        rng: KeyedRng::new(RngPurpose::Simulation, plan.seed, u64::MAX),
        groups: Vec::new(),
        moves: Vec::new(),
    };
    let mut queue: VecDeque<SequencedProposal> = VecDeque::new();
    let mut episodes = 0;
    while episodes < plan.episodes {
        while queue.len() <= plan.queue_length {
            queue.push_back(simulator.curriculum.propose());
        }
        let Some(SequencedProposal { seq, proposal }) = queue.pop_front() else { break };
        let has_moved = simulator.run_group(episodes, seq, &proposal);
        episodes += u64::from(plan.group_size);
        if has_moved {
            queue.retain(|next| simulator.curriculum.is_current(next.seq, &next.proposal));
        }
    }
    let Simulator { curriculum, learner, groups, moves, .. } = simulator;
    Ok(SimulationTrace { groups, moves, status: curriculum.status(), learner, curriculum })
}

struct Simulator<'a> {
    plan: &'a SimulationPlan,
    learner: Learner,
    curriculum: Curriculum,
    /// Scenarios that may be repeated, by the seq of the proposal that made them.
    scenarios: BTreeMap<u64, SyntheticScenario>,
    rng: KeyedRng,
    groups: Vec<SimulatedGroup>,
    moves: Vec<SimulatedMove>,
}

impl Simulator<'_> {
    /// Runs the group of a proposal; true if it caused a move.
    fn run_group(&mut self, episodes_before: u64, seq: u64, proposal: &Proposal) -> bool {
        let tasks = &self.plan.settings.tasks;
        let Some(task_index) = tasks.iter().position(|task| task.task == proposal.task) else {
            return false;
        };
        let scenario = self.scenario(seq, proposal, difficulty(&tasks[task_index], &proposal.params));
        let ability = self.learner.ability(&proposal.task);
        let group_size = self.plan.group_size;
        let result =
            self.learner.run_group(&proposal.task, &scenario, group_size, proposal.train, &mut self.rng);
        let placed = self.curriculum.status().get(task_index).is_some_and(|status| status.placement_done);
        self.groups.push(SimulatedGroup {
            episodes_before,
            task_index,
            role: proposal.role,
            difficulty: scenario.difficulty,
            ability,
            contested: scenario.contested,
            train: proposal.train,
            placed,
            finished: result.finished,
            successes: result.successes,
        });
        let outcome = group_outcome(seq, proposal, &scenario, result);
        let ObservedOutcome { moves, .. } = self.curriculum.observe(&outcome);
        self.curriculum.take_background_jobs().iter().for_each(|job| job.run());
        let has_moved = !moves.is_empty();
        let moves = moves.into_iter().map(|level_move| SimulatedMove { episodes_before, level_move });
        self.moves.extend(moves);
        has_moved
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

/// Outcome of a group, as the service would report it to the curriculum.
#[must_use]
pub fn group_outcome(
    seq: u64,
    proposal: &Proposal,
    scenario: &SyntheticScenario,
    result: GroupResult,
) -> GroupOutcome {
    let GroupResult { finished, successes, failed } = result;
    let success_rate = if finished > 0 { f64::from(successes) / f64::from(finished) } else { 0.0 };
    GroupOutcome {
        proposal: seq,
        task: proposal.task.clone(),
        level: proposal.level,
        epoch: proposal.epoch,
        role: proposal.role,
        contested: scenario.contested,
        finished,
        successes,
        failed,
        expired: 0,
        evidence: true,
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
