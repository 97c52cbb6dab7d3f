//! Tests of the curriculum as a whole: rules, laws under simulated learners, and the fold.

mod fold;
mod laws;
mod rules;

use std::collections::VecDeque;

use env_core::draws::{Draws, Purpose};

use super::*;

pub(super) const SURVIVAL: &str = "kessler/survival";
pub(super) const ECO: &str = "kessler/eco_station";
pub(super) const RENDEZVOUS: &str = "kessler/rendezvous";

/// A contested frontier outcome of epoch 0 that is evidence.
pub(super) fn outcome(task: &str, level: Option<u32>, finished: u32, successes: u32) -> GroupOutcome {
    GroupOutcome {
        proposal: 0,
        task: task.to_owned(),
        level,
        epoch: 0,
        role: Role::Frontier,
        contested: true,
        finished,
        successes,
        failed: 0,
        expired: 0,
        evidence: true,
        mean_score: 0.5,
        mean_skill: None,
        source: Source::Fresh,
        params: Vec::new(),
        signals: Signals::default(),
    }
}

/// The outcome of a proposal.
fn answer(seq: u64, proposal: &Proposal, finished: u32, successes: u32) -> GroupOutcome {
    GroupOutcome {
        proposal: seq,
        epoch: proposal.epoch,
        role: proposal.role,
        contested: proposal.contested,
        source: proposal.source.clone(),
        params: if proposal.level.is_none() { proposal.params.clone() } else { Vec::new() },
        signals: Signals {
            regret: (finished > 0).then(|| 1.0 - f64::from(successes.min(finished)) / f64::from(finished)),
            panel: Some(0.25),
            ..Signals::default()
        },
        ..outcome(&proposal.task, proposal.level, finished, successes)
    }
}

/// The ladder over these tasks, from level 0, without placement.
fn from_zero(tasks: &[&str]) -> Settings {
    Settings { placement: false, ..placed(tasks) }
}

/// The ladder over these tasks, with placement.
fn placed(tasks: &[&str]) -> Settings {
    Settings::ladder(tasks.iter().map(|task| TaskPlan::standard(task).unwrap()).collect())
}

/// A simulated training run.
struct Simulation {
    curriculum: Curriculum,
    group_size: u32,
    /// Groups leased before the first comes back.
    lag: usize,
    chance: Draws,
    in_flight: VecDeque<(u64, Proposal)>,
    moves: Vec<Move>,
    /// Contested scenarios observed.
    contested: u32,
}

impl Simulation {
    fn new(seed: u64, settings: Settings) -> Self {
        Self {
            curriculum: Curriculum::new(seed, settings).unwrap(),
            group_size: 1,
            lag: 0,
            chance: Draws::new(Purpose::Course, seed, u64::MAX),
            in_flight: VecDeque::new(),
            moves: Vec::new(),
            contested: 0,
        }
    }

    /// One proposal goes out and the oldest in flight comes back; `ability` says, per contested scenario, how likely
    /// an episode succeeds. What is not contested succeeds by itself.
    fn step(&mut self, ability: &mut dyn FnMut(&Proposal, &mut Draws) -> f64) -> Option<GroupOutcome> {
        self.step_with(ability, |_| ())
    }

    /// The same, with a trainer that reports something else than what happened.
    fn step_with(
        &mut self,
        ability: &mut dyn FnMut(&Proposal, &mut Draws) -> f64,
        tamper: impl Fn(&mut GroupOutcome),
    ) -> Option<GroupOutcome> {
        let proposed = self.curriculum.propose();
        self.in_flight.push_back(proposed);
        if self.in_flight.len() <= self.lag {
            return None;
        }
        let (seq, proposal) = self.in_flight.pop_front().unwrap();
        let p = if proposal.contested { ability(&proposal, &mut self.chance) } else { 1.0 };
        let successes = (0..self.group_size).filter(|_| self.chance.chance(p)).count();
        let mut outcome = answer(seq, &proposal, self.group_size, u32::try_from(successes).unwrap());
        tamper(&mut outcome);
        self.contested += u32::from(outcome.contested);
        self.moves.extend(self.curriculum.observe(&outcome).1);
        Some(outcome)
    }

    fn level(&self, task: &str) -> u32 {
        self.status(task).level.unwrap()
    }

    fn status(&self, task: &str) -> TaskStatus {
        self.curriculum.status().into_iter().find(|status| status.task == task).unwrap()
    }

    fn ups(&self) -> usize {
        self.moves.iter().filter(|made| made.kind == MoveKind::Up).count()
    }
}
