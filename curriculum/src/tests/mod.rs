//! Tests of the curriculum as a whole.
//!
//! - `rules`: single rules of the ladder, the baselines and the settings.
//! - `laws`: statistical properties over many seeds.
//! - `fold`: snapshots and event replay.

mod fold;
mod laws;
mod rules;

use std::collections::VecDeque;

use env_core::keyed_rng::{KeyedRng, RngPurpose};

use super::*;

pub(super) const SURVIVAL: &str = "kessler/survival";
pub(super) const ECO: &str = "kessler/eco_station";
pub(super) const RENDEZVOUS: &str = "kessler/rendezvous";

/// A contested frontier outcome of epoch 0 that counts as evidence.
pub(super) fn outcome(task: &str, level: Option<u32>, finished: u32, successes: u32) -> GroupOutcome {
    GroupOutcome {
        proposal: 0,
        task: task.to_owned(),
        level,
        epoch: 0,
        role: ProposalRole::Frontier,
        contested: true,
        finished,
        successes,
        failed: 0,
        expired: 0,
        evidence: true,
        mean_score: 0.5,
        mean_skill: None,
        source: ScenarioSource::Fresh,
        params: Vec::new(),
        signals: LearningSignals::default(),
    }
}

/// The outcome of a proposal, whose scenario is contested if the proposal asked for it.
fn outcome_of(proposed: &SequencedProposal, finished: u32, successes: u32) -> GroupOutcome {
    let proposal = &proposed.proposal;
    GroupOutcome {
        proposal: proposed.seq,
        epoch: proposal.epoch,
        role: proposal.role,
        contested: proposal.contested,
        source: proposal.source.clone(),
        params: if proposal.level.is_none() { proposal.params.clone() } else { Vec::new() },
        signals: LearningSignals {
            regret: (finished > 0).then(|| 1.0 - f64::from(successes.min(finished)) / f64::from(finished)),
            panel: Some(0.25),
            ..LearningSignals::default()
        },
        ..outcome(&proposal.task, proposal.level, finished, successes)
    }
}

/// A ladder over these tasks that starts at level 0.
fn without_placement(tasks: &[&str]) -> Settings {
    Settings { placement: false, ..with_placement(tasks) }
}

/// A ladder over these tasks that starts with a placement.
fn with_placement(tasks: &[&str]) -> Settings {
    Settings::ladder(tasks.iter().map(|task| TaskPlan::standard(task).unwrap()).collect())
}

/// A simulated training run.
struct TrainingRun {
    curriculum: Curriculum,
    group_size: u32,
    /// Number of groups that are leased before the first one is reported.
    lag: usize,
    rng: KeyedRng,
    in_flight: VecDeque<SequencedProposal>,
    moves: Vec<LevelMove>,
    /// Number of contested scenarios observed.
    contested: u32,
}

impl TrainingRun {
    fn new(seed: u64, settings: Settings) -> Self {
        Self {
            curriculum: Curriculum::new(seed, settings).unwrap(),
            group_size: 1,
            lag: 0,
            rng: KeyedRng::new(RngPurpose::Curriculum, seed, u64::MAX),
            in_flight: VecDeque::new(),
            moves: Vec::new(),
            contested: 0,
        }
    }

    /// Makes one proposal and reports the oldest one in flight. `ability` returns the success probability of an
    /// episode in a contested scenario; uncontested scenarios always succeed.
    fn step(&mut self, ability: &mut dyn FnMut(&Proposal, &mut KeyedRng) -> f64) -> Option<GroupOutcome> {
        self.step_tampered(ability, |_| ())
    }

    /// As `step`, with a trainer that alters its reports.
    fn step_tampered(
        &mut self,
        ability: &mut dyn FnMut(&Proposal, &mut KeyedRng) -> f64,
        tamper: impl Fn(&mut GroupOutcome),
    ) -> Option<GroupOutcome> {
        self.in_flight.push_back(self.curriculum.propose());
        if self.in_flight.len() <= self.lag {
            return None;
        }
        let proposed = self.in_flight.pop_front().unwrap();
        let proposal = &proposed.proposal;
        let p = if proposal.contested { ability(proposal, &mut self.rng) } else { 1.0 };
        let successes = (0..self.group_size).filter(|_| self.rng.bernoulli(p)).count();
        let mut outcome = outcome_of(&proposed, self.group_size, u32::try_from(successes).unwrap());
        tamper(&mut outcome);
        self.contested += u32::from(outcome.contested);
        self.moves.extend(self.curriculum.observe(&outcome).moves);
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
