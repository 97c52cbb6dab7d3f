//! Laws of evidence: no trainer moves a level by results that it hides, delays, reorders, relabels or repeats.
//!
//! A case is a run with random settings, a random learner and a random trainer. The learner's first attempts are fixed
//! by the case, so an oracle knows the true value of each slot. The laws compare the moves of the run with the moves
//! that the true values call for. A mutant puts an old rule of evidence back; each law must fail for it.

use rayon::prelude::*;

use super::*;
use crate::core::evidence::block::{
    BLOCK_SIZE, HALF_DOWN_MEAN, HALF_UP_MEAN, MASTERED_Q10, OUT_OF_REACH_Q90,
};
use crate::core::evidence::posterior::Posterior;

/// Number of random cases of the laws. Those beyond [`MUTANT_CASES`] are run by long tests only.
const CASES: u64 = 100_000;
/// Number of random cases within which a mutant must violate a law.
const MUTANT_CASES: u64 = 20_000;
/// Number of groups of a lease.
const LEASE: usize = 8;
/// Number of leases of a case: five blocks.
const LEASES: usize = 20;
/// Number of later results after which a slot without a result is missing.
const LATER: u32 = 64;

/// Rules by which results become evidence: those in force, or one of the rules before them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rules {
    InForce,
    /// Missing episodes are left out of the success rate, and groups without results are left out.
    MissingLeftOut,
    /// A group counts when it is reported, not in the order of the leases.
    OrderOfReports,
    /// A later attempt at the scenario counts.
    LastAttempt,
    /// Missing episodes count as failures for moves down, too.
    MissingMovesDown,
}

/// Habits of a trainer, each with its probability for a group.
#[derive(Debug, Clone, Copy)]
struct Trainer {
    /// Hides the episodes that failed: as failures of the infrastructure, by an old policy version, or by a release.
    hides_failures: f64,
    /// Loses episodes regardless of their result.
    loses: f64,
    /// Keeps a group that did not succeed leased for ever.
    withholds: f64,
    /// Reports a group that succeeded late.
    delays: f64,
    /// Repeats a scenario that did not succeed until it does, and reports that.
    retries: f64,
}

/// Random case of the laws.
#[derive(Debug, Clone)]
struct Case {
    seed: u64,
    settings: Settings,
    group_size: u32,
    /// Success rate of the learner at level 0, and its fall with each level.
    success: (f64, f64),
    trainer: Trainer,
}

impl Case {
    fn draw(seed: u64) -> Self {
        let mut rng = KeyedRng::new(RngPurpose::Simulation, seed, 0);
        let mut settings = match rng.below(3) {
            0 => with_placement(&[SURVIVAL]),
            _ => without_placement(&[SURVIVAL]),
        };
        settings.target = if rng.bernoulli(0.5) { Target::Mastery } else { Target::Half };
        settings.contested_share = 1.0;
        settings.frontier_share = 0.5 + 0.5 * rng.uniform();
        // Half of the habits are absent, so that single habits occur, too.
        let habit = |rng: &mut KeyedRng| if rng.bernoulli(0.5) { rng.uniform() } else { 0.0 };
        let trainer = Trainer {
            hides_failures: habit(&mut rng),
            loses: 0.2 * habit(&mut rng),
            withholds: habit(&mut rng),
            delays: habit(&mut rng),
            retries: habit(&mut rng),
        };
        let group_size = [1, 2, 4, 8][rng.below(4) as usize];
        // Some learners fail at every level above the first, so that moves down occur.
        let fall = if rng.bernoulli(0.3) { 1.0 } else { 0.3 * rng.uniform() };
        let success = (0.1 + 0.85 * rng.uniform(), fall);
        Self { seed, settings, group_size, success, trainer }
    }

    /// Number of successes of the first attempt at the slot `number` of a level: the same for every trainer.
    fn first_attempt(&self, level: u32, number: u64) -> u32 {
        let key = u64::from(level) << 32 | number;
        let mut rng = KeyedRng::new(RngPurpose::Curriculum, self.seed, key);
        let probability = (self.success.0 - self.success.1 * f64::from(level)).max(0.0);
        (0..self.group_size).map(|_| u32::from(rng.bernoulli(probability))).sum()
    }
}

/// A slot of a case with its true value.
#[derive(Debug, Clone)]
struct TrueSlot {
    slot: Slot,
    success_rate: f64,
}

/// A group that is leased and not reported.
struct Leased {
    proposed: SequencedProposal,
    slot: TrueSlot,
    successes: u32,
    /// Lease at which the group is reported; `None` if it never is.
    due: Option<usize>,
}

/// A case that was run: its slots in the order of opening, and its moves.
struct RunCase {
    slots: Vec<TrueSlot>,
    moves: Vec<LevelMove>,
    mastery: Vec<Mastery>,
}

/// Runs a case with a trainer, under these rules.
fn run_case(case: &Case, trainer: Trainer, rules: Rules) -> RunCase {
    let mut run = CaseRun {
        case,
        trainer,
        rules,
        curriculum: Curriculum::new(case.seed, case.settings.clone()).unwrap(),
        rng: KeyedRng::new(RngPurpose::Simulation, case.seed, 1),
        leased: Vec::new(),
        counts: std::collections::BTreeMap::new(),
        done: RunCase { slots: Vec::new(), moves: Vec::new(), mastery: Vec::new() },
    };
    for lease in 0..LEASES {
        run.lease(lease);
        run.report_due(lease);
        run.close_stalled();
    }
    run.done.mastery = run.curriculum.mastery();
    run.done
}

struct CaseRun<'a> {
    case: &'a Case,
    trainer: Trainer,
    rules: Rules,
    curriculum: Curriculum,
    rng: KeyedRng,
    leased: Vec<Leased>,
    /// Number of slots so far, by level.
    counts: std::collections::BTreeMap<u32, u64>,
    done: RunCase,
}

impl CaseRun<'_> {
    fn lease(&mut self, lease: usize) {
        for _ in 0..LEASE {
            let proposed = self.curriculum.propose();
            let level = proposed.proposal.level.unwrap();
            let number = self.counts.entry(level).or_default();
            let successes = self.case.first_attempt(level, *number);
            *number += 1;
            let slot = Slot { lease: lease as u64, ..slot_of(&outcome_of(&proposed, 1, 0)) };
            let success_rate = f64::from(successes) / f64::from(self.case.group_size);
            let slot = TrueSlot { slot, success_rate };
            self.done.slots.push(slot.clone());
            let succeeded = successes == self.case.group_size;
            // The draws of a group do not depend on its result, so that trainers are comparable.
            let (withheld, delayed) = (
                self.rng.bernoulli(self.trainer.withholds) && !succeeded,
                self.rng.bernoulli(self.trainer.delays) && succeeded,
            );
            let delay = self.rng.below(8) as usize;
            let due = (!withheld).then_some(if delayed { lease + delay } else { lease });
            self.leased.push(Leased { proposed, slot, successes, due });
        }
        if self.rules != Rules::OrderOfReports {
            let opened = &self.done.slots[self.done.slots.len() - LEASE..];
            let opened: Vec<Slot> = opened.iter().map(|slot| slot.slot.clone()).collect();
            self.curriculum.open_slots(&opened);
        }
    }

    /// Reports the groups that are due, in random order.
    fn report_due(&mut self, lease: usize) {
        let (mut due, kept): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.leased).into_iter().partition(|group| group.due == Some(lease));
        self.leased = kept;
        while !due.is_empty() {
            let at = self.rng.below(u32::try_from(due.len()).unwrap()) as usize;
            let group = due.swap_remove(at);
            self.report(&group);
        }
    }

    fn report(&mut self, group: &Leased) {
        let size = self.case.group_size;
        let failures = size - group.successes;
        let hidden = if self.rng.bernoulli(self.trainer.hides_failures) { failures } else { 0 };
        let lost = (0..group.successes).filter(|_| self.rng.bernoulli(self.trainer.loses)).count() as u32;
        let (finished, successes) = (size - hidden - lost, group.successes - lost);
        let is_retried = self.rng.bernoulli(self.trainer.retries) && group.successes < size;
        if !(is_retried && self.rules == Rules::LastAttempt) {
            self.observe(group, finished, successes);
        }
        if is_retried {
            self.observe(group, size, size);
        }
    }

    fn observe(&mut self, group: &Leased, finished: u32, successes: u32) {
        let mut value = interval(self.case.group_size, finished, successes);
        match self.rules {
            Rules::MissingLeftOut if finished == 0 => {
                let moves = self.curriculum.withdraw_slots(std::slice::from_ref(&group.slot.slot)).moves;
                self.done.moves.extend(moves);
                return;
            }
            Rules::MissingLeftOut => value = interval(finished, finished, successes),
            Rules::MissingMovesDown => value.high = value.low,
            Rules::OrderOfReports => {
                self.curriculum.open_slots(std::slice::from_ref(&group.slot.slot));
            }
            Rules::InForce | Rules::LastAttempt => {}
        }
        let outcome =
            GroupOutcome { evidence: Some(value), ..outcome_of(&group.proposed, finished, successes) };
        let moves = self.curriculum.observe(&outcome).moves;
        self.done.moves.extend(moves);
    }

    fn close_stalled(&mut self) {
        loop {
            let stalled = self.curriculum.stalled_slots(LATER);
            let overdue: Vec<u64> = stalled.iter().map(|slot| slot.key.proposal).collect();
            let (closed, kept): (Vec<_>, Vec<_>) = std::mem::take(&mut self.leased)
                .into_iter()
                .partition(|group| overdue.contains(&group.proposed.seq));
            self.leased = kept;
            if closed.is_empty() {
                return;
            }
            closed.iter().for_each(|group| self.observe(group, 0, 0));
        }
    }
}

/// The slots that a move may rest on, by their true values: blocks of consecutive slots of its level and epoch.
fn true_blocks(done: &RunCase, level: u32, epoch: u32, role: ProposalRole, size: u32) -> Vec<f64> {
    let slots = done
        .slots
        .iter()
        .filter(|of| of.slot.level == Some(level) && of.slot.epoch == epoch && of.slot.role == role);
    let values: Vec<f64> = slots.map(|of| of.success_rate).collect();
    values.chunks_exact(size as usize).map(|block| block.iter().sum()).collect()
}

/// True if the true values of consecutive blocks call for the move. A promotion by hidden results would be one that
/// they do not call for.
fn is_honest_move(case: &Case, done: &RunCase, made: &LevelMove, epoch: u32) -> bool {
    let Some(from) = made.from else { return is_honest_placement(done, made) };
    let blocks = true_blocks(done, from, epoch, ProposalRole::Frontier, BLOCK_SIZE);
    let quantile = |sum: f64, p: f64| Posterior { n: BLOCK_SIZE, sum }.quantile(p);
    let (mean, is_up) = (|sum: f64| sum / f64::from(BLOCK_SIZE), made.kind == MoveKind::Up);
    let calls_for = |sum: f64| match (case.settings.target, is_up) {
        (Target::Mastery, true) => quantile(sum, 0.1) >= MASTERED_Q10,
        (Target::Mastery, false) => quantile(sum, 0.9) <= OUT_OF_REACH_Q90,
        (Target::Half, true) => mean(sum) > HALF_UP_MEAN,
        (Target::Half, false) => mean(sum) < HALF_DOWN_MEAN,
    };
    match case.settings.target {
        Target::Mastery => blocks.windows(2).any(|pair| calls_for(pair[0]) && calls_for(pair[1])),
        Target::Half => blocks.iter().any(|&sum| calls_for(sum)),
    }
}

/// True if every probe that passed passes by its true values.
fn is_honest_placement(done: &RunCase, made: &LevelMove) -> bool {
    (0..).zip(&made.evidence.probes).all(|(epoch, probe)| {
        let probes = true_blocks(done, probe.level, epoch, ProposalRole::Placement, 16);
        !probe.passed || probes.first().is_some_and(|sum| sum / 16.0 >= 0.5)
    })
}

/// Epochs of the moves: each step of a placement and each move ends one.
fn epochs(moves: &[LevelMove]) -> Vec<u32> {
    let mut next = 0;
    let epoch_of = |made: &LevelMove| {
        let epoch = next;
        next += if made.from.is_none() { u32::try_from(made.evidence.probes.len()).unwrap() } else { 1 };
        epoch
    };
    moves.iter().map(epoch_of).collect()
}

/// Law that every run keeps, whatever its trainer does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Law {
    /// A level rises only by blocks whose true values call for it.
    Up,
    /// A level falls only by blocks whose true values call for it.
    Down,
    /// If the first move is a promotion, honest reports lead to the same promotion, or place the task as high.
    Honest,
    /// The interval of the shown mastery contains the true success.
    Shown,
}

impl Law {
    const ALL: [Self; 4] = [Self::Up, Self::Down, Self::Honest, Self::Shown];

    fn is_kept(self, case: &Case, done: &RunCase, rules: Rules) -> bool {
        let is_honest = |(made, epoch)| is_honest_move(case, done, made, epoch);
        let moves = || done.moves.iter().zip(epochs(&done.moves));
        match self {
            Self::Up => moves().filter(|(made, _)| made.kind != MoveKind::Down).all(is_honest),
            Self::Down => moves().filter(|(made, _)| made.kind == MoveKind::Down).all(is_honest),
            Self::Honest => is_first_move_honest(case, done, rules),
            Self::Shown => is_true_success_shown(done),
        }
    }
}

/// At level 0 the first move can only be up.
fn is_first_move_honest(case: &Case, done: &RunCase, rules: Rules) -> bool {
    let Some(first) = done.moves.first() else { return true };
    let habits = Trainer { hides_failures: 0.0, loses: 0.0, withholds: 0.0, delays: 0.0, retries: 0.0 };
    let honest = run_case(case, habits, rules);
    honest.moves.first().is_some_and(|honest| honest.kind == first.kind && honest.to >= first.to)
}

/// Compares the mastery of level 0 with the true values of its slots.
fn is_true_success_shown(done: &RunCase) -> bool {
    let Some(shown) = done.mastery.iter().find(|shown| shown.level == Some(0)) else { return true };
    let slots = done.slots.iter().filter(|of| of.slot.level == Some(0));
    let values: Vec<f64> = slots.map(|of| of.success_rate).collect();
    let settled = shown.seen as usize;
    let first = settled.saturating_sub(shown.n as usize);
    let Some(counted) = values.get(first..settled) else { return false };
    let sum: f64 = counted.iter().sum();
    (shown.low - 1e-9..=shown.high + 1e-9).contains(&sum)
}

/// First case among `cases` that violates one of the laws.
fn find_violation(cases: u64, rules: Rules, laws: &[Law]) -> Option<(u64, Law)> {
    (0..cases).into_par_iter().find_map_first(|seed| {
        let case = Case::draw(seed);
        let done = run_case(&case, case.trainer, rules);
        laws.iter().find(|law| !law.is_kept(&case, &done, rules)).map(|law| (seed, *law))
    })
}

#[test]
fn no_trainer_moves_a_level_by_missing_results() {
    let is_long = std::env::var_os("SPARRING_LONG_TESTS").is_some();
    let cases = if is_long { CASES } else { MUTANT_CASES };
    let found = find_violation(cases, Rules::InForce, &Law::ALL);
    assert!(found.is_none(), "{found:?}: {:?}", found.map(|(seed, _)| Case::draw(seed)));
}

#[test]
fn cases_of_the_laws_have_moves_of_every_kind() {
    let counts = |kind: MoveKind| -> usize {
        let moves = |seed| {
            let case = Case::draw(seed);
            let done = run_case(&case, case.trainer, Rules::InForce);
            done.moves.iter().filter(|made| made.kind == kind).count()
        };
        (0..2000u64).into_par_iter().map(moves).sum()
    };
    let counted = (counts(MoveKind::Placement), counts(MoveKind::Up), counts(MoveKind::Down));
    println!("placements, moves up and moves down in 2 000 cases: {counted:?}");
    assert!(counted.0 > 200 && counted.1 > 200 && counted.2 > 20, "{counted:?}");
}

#[test]
fn each_old_rule_violates_its_laws() {
    let promoting: &[Law] = &[Law::Up, Law::Honest, Law::Shown];
    for (rules, laws) in [
        (Rules::MissingLeftOut, promoting),
        (Rules::OrderOfReports, promoting),
        (Rules::LastAttempt, promoting),
        (Rules::MissingMovesDown, &[Law::Down, Law::Shown]),
    ] {
        for law in laws {
            let found = find_violation(MUTANT_CASES, rules, &[*law]);
            println!("{rules:?}, {law:?}: {found:?}");
            assert!(found.is_some(), "{rules:?} keeps the law {law:?}");
        }
    }
}
