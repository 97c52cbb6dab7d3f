//! Tests of the curriculum as a whole.
//!
//! - `rules`: single rules of the ladder, the baselines and the settings.
//! - `slots`: which results count as evidence, and in which order.
//! - `laws`: statistical properties over many seeds.
//! - `evidence_laws`: no trainer can move a level by hiding, delaying or repeating results.
//! - `fold`: snapshots and event replay.

mod damaged_snapshots;
mod evidence_laws;
mod fold;
mod laws;
mod rules;
mod slots;

use std::collections::VecDeque;

use env_core::keyed_rng::{KeyedRng, RngPurpose};

use super::*;

pub(super) const SURVIVAL: &str = "kessler/survival";
pub(super) const ECO: &str = "kessler/eco_station";
pub(super) const RENDEZVOUS: &str = "kessler/rendezvous";

/// A contested frontier outcome of epoch 0 that is evidence, without missing episodes.
pub(super) fn outcome(task: &str, level: Option<u32>, finished: u32, successes: u32) -> GroupOutcome {
    GroupOutcome {
        is_designed: false,
        proposal: 0,
        group: 0,
        task: task.to_owned(),
        level,
        start_rung: None,
        chain: None,
        epoch: 0,
        role: ProposalRole::Frontier,
        contested: true,
        finished,
        successes,
        steps: 50 * u64::from(finished),
        evidence: Some(interval(finished, finished, successes)),
        usable: finished > 0,
        mean_score: 0.5,
        mean_skill: None,
        source: ScenarioSource::Fresh,
        params: Vec::new(),
        signals: LearningSignals::default(),
    }
}

/// Interval of a group of `size` episodes.
pub(super) fn interval(size: u32, finished: u32, successes: u32) -> SuccessInterval {
    SuccessInterval::of_episodes(EpisodeTally { size, finished, successes, abandoned: 0 })
}

/// The slot of an outcome, in the lease 0.
pub(super) fn slot_of(outcome: &GroupOutcome) -> Slot {
    Slot {
        proposal: outcome.proposal,
        group: outcome.group,
        lease: 0,
        task: outcome.task.clone(),
        level: outcome.level,
        epoch: outcome.epoch,
        role: outcome.role,
    }
}

/// Opens a slot of its own for an outcome and observes it. Returns the moves it causes.
pub(super) fn observe_new(curriculum: &mut Curriculum, outcome: &GroupOutcome) -> Vec<LevelMove> {
    let outcome = GroupOutcome { proposal: curriculum.next_seq(), ..outcome.clone() };
    if outcome.evidence.is_some() {
        curriculum.open_slots(&[slot_of(&outcome)]);
    }
    curriculum.observe(&outcome).moves
}

/// True if the scenario of a proposal is evidence: it is contested if the proposal asked for it.
fn is_slot(proposal: &Proposal) -> bool {
    proposal.contested && proposal.source.is_fresh() && proposal.has_full_start()
}

/// A frontier outcome at the current level and epoch.
fn current_outcome(curriculum: &Curriculum, task: &str, finished: u32, successes: u32) -> GroupOutcome {
    let status = curriculum.status().into_iter().find(|status| status.task == task).unwrap();
    GroupOutcome { epoch: status.epoch, ..outcome(task, status.level, finished, successes) }
}

/// Fills a block of 32 with this many successes and returns the moves it causes.
fn fill_block(curriculum: &mut Curriculum, successes: u32) -> Vec<LevelMove> {
    let first = current_outcome(curriculum, SURVIVAL, 1, 0);
    (0..32)
        .flat_map(|at| {
            let successes = u32::from(at < successes);
            let value = interval(1, 1, successes);
            observe_new(curriculum, &GroupOutcome { successes, evidence: Some(value), ..first.clone() })
        })
        .collect()
}

fn survival_status(curriculum: &Curriculum) -> TaskStatus {
    curriculum.status().into_iter().find(|status| status.task == SURVIVAL).unwrap()
}

fn ladder() -> Curriculum {
    Curriculum::new(1, without_placement(&[SURVIVAL])).unwrap()
}

/// The outcome of a proposal, whose scenario is contested if the proposal asked for it.
fn outcome_of(proposed: &SequencedProposal, finished: u32, successes: u32) -> GroupOutcome {
    let proposal = &proposed.proposal;
    GroupOutcome {
        proposal: proposed.seq,
        start_rung: proposal.start_rung,
        chain: proposal.chain,
        epoch: proposal.epoch,
        role: proposal.role,
        contested: proposal.contested,
        evidence: is_slot(proposal).then(|| interval(finished, finished, successes)),
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
        let proposed = self.curriculum.propose();
        if is_slot(&proposed.proposal) {
            self.curriculum.open_slots(&[slot_of(&outcome_of(&proposed, 1, 0))]);
        }
        self.in_flight.push_back(proposed);
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
