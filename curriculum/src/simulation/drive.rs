//! A curriculum and a learner against each other.

use std::collections::{BTreeMap, VecDeque};

use env_core::Draws;
use env_core::draws::Purpose;

use super::learner::{Flown, Learner};
use super::synthetic::Synthetic;
use crate::{
    Curriculum, GroupOutcome, Move, Proposal, Role, Settings, SettingsError, Signals, Source, TaskStatus,
    difficulty,
};

/// What success and failure score: what a group of both has a variance of.
const SCORES: (f64, f64) = (0.9, 0.2);

/// What is to be simulated.
#[derive(Debug, Clone)]
pub struct Plan {
    /// What the curriculum is told.
    pub settings: Settings,
    /// Episodes flown in all.
    pub episodes: u64,
    /// Episodes of a group.
    pub group_size: u32,
    /// Proposals that wait while one is flown: those that a move makes stale are dropped, as the service does.
    pub ahead: usize,
    /// What everything is drawn from.
    pub seed: u64,
}

/// A group that was flown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Episodes flown before it.
    pub at: u64,
    /// The place of its task among those of the settings.
    pub task: usize,
    /// What it was for.
    pub role: Role,
    /// How hard its params are, in rows.
    pub params: f64,
    /// How good the learner was then, in rows.
    pub skill: f64,
    /// Whether its scenario was contested.
    pub contested: bool,
    /// Whether it was learnt from.
    pub train: bool,
    /// Whether the task's level was found by then.
    pub placed: bool,
    /// Episodes that were reported as finished.
    pub finished: u32,
    /// Of these, successes.
    pub successes: u32,
}

impl Sample {
    /// Whether all of several episodes came to the same.
    #[must_use]
    pub const fn flat(&self) -> bool {
        self.finished > 1 && (self.successes == 0 || self.successes == self.finished)
    }
}

/// All that happened.
#[derive(Debug)]
pub struct Track {
    /// The groups, in order.
    pub samples: Vec<Sample>,
    /// Moves, each with the episodes flown before it.
    pub moves: Vec<(u64, Move)>,
    /// Where tasks stand at the end.
    pub status: Vec<TaskStatus>,
    /// The learner at the end.
    pub learner: Learner,
    /// The curriculum at the end.
    pub curriculum: Curriculum,
}

/// Lets them at each other.
///
/// # Errors
/// Settings that cannot be.
pub fn simulate(plan: &Plan, learner: Learner) -> Result<Track, SettingsError> {
    let mut drive = Drive {
        plan,
        learner,
        curriculum: Curriculum::new(plan.seed, plan.settings.clone())?,
        scenarios: BTreeMap::new(),
        draws: Draws::new(Purpose::Synthetic, plan.seed, u64::MAX),
        track: (Vec::new(), Vec::new()),
    };
    let mut queue: VecDeque<(u64, Proposal)> = VecDeque::new();
    let mut flown = 0;
    while flown < plan.episodes {
        while queue.len() <= plan.ahead {
            queue.push_back(drive.curriculum.propose());
        }
        let Some((seq, proposal)) = queue.pop_front() else { break };
        let moved = drive.once(flown, seq, &proposal);
        flown += u64::from(plan.group_size);
        if moved {
            queue.retain(|(seq, proposal)| drive.curriculum.is_current(*seq, proposal));
        }
    }
    let Drive { curriculum, learner, track: (samples, moves), .. } = drive;
    Ok(Track { samples, moves, status: curriculum.status(), learner, curriculum })
}

struct Drive<'a> {
    plan: &'a Plan,
    learner: Learner,
    curriculum: Curriculum,
    /// By the seq of the proposal that made each.
    scenarios: BTreeMap<u64, Synthetic>,
    draws: Draws,
    track: (Vec<Sample>, Vec<(u64, Move)>),
}

impl Drive<'_> {
    /// One proposal; whether something moved.
    fn once(&mut self, at: u64, seq: u64, proposal: &Proposal) -> bool {
        let Some(place) = self.plan.settings.tasks.iter().position(|task| task.task == proposal.task) else {
            return false;
        };
        let params = difficulty(&self.plan.settings.tasks[place], &proposal.params);
        let scenario = self.scenario(seq, proposal, params);
        let skill = self.learner.skill(&proposal.task);
        let wanted = (self.plan.group_size, proposal.train);
        let flown = self.learner.fly(&proposal.task, &scenario, wanted, &mut self.draws);
        let placed = self.curriculum.status().get(place).is_some_and(|status| status.placed);
        self.track.0.push(Sample {
            at,
            task: place,
            role: proposal.role,
            params: scenario.params,
            skill,
            contested: scenario.contested,
            train: proposal.train,
            placed,
            finished: flown.finished,
            successes: flown.successes,
        });
        let (_, moves) = self.curriculum.observe(&outcome(seq, proposal, &scenario, flown));
        self.curriculum.jobs().iter().for_each(|job| job.run());
        let moved = !moves.is_empty();
        self.track.1.extend(moves.into_iter().map(|made| (at, made)));
        moved
    }

    fn scenario(&mut self, seq: u64, proposal: &Proposal, params: f64) -> Synthetic {
        let seed = self.plan.seed;
        let known = |of: u64| self.scenarios.get(&of).copied();
        let drawn = || Synthetic::drawn(seed, seq, proposal, params);
        let scenario = match proposal.source {
            Source::Fresh => drawn(),
            Source::Again { of } => known(of).unwrap_or_else(drawn),
            Source::Edited { of } => known(of).unwrap_or_else(drawn).edited(seed, seq),
            Source::Chosen { among, base, panel } => {
                Synthetic::chosen(seed, seq, proposal, params, (among, base, panel))
            }
        };
        if self.plan.settings.strategy.returns() {
            self.scenarios.insert(seq, scenario);
        }
        scenario
    }
}

/// What the curriculum is told of a group.
#[must_use]
pub fn outcome(seq: u64, proposal: &Proposal, scenario: &Synthetic, flown: Flown) -> GroupOutcome {
    let Flown { finished, successes, failed } = flown;
    let share = if finished > 0 { f64::from(successes) / f64::from(finished) } else { 0.0 };
    let score = SCORES.1 + (SCORES.0 - SCORES.1) * share;
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
        mean_score: score,
        mean_skill: None,
        source: proposal.source.clone(),
        params: if proposal.level.is_none() { proposal.params.clone() } else { Vec::new() },
        signals: Signals {
            // Where nobody can succeed the planner does not either.
            regret: (finished > 0).then_some(if scenario.solvable { 1.0 - share } else { 0.0 }),
            panel: Some(scenario.panel),
            ..Signals::default()
        },
    }
}
