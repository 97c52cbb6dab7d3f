//! Statistical properties of the ladder with simulated learners, over many seeds.

use rayon::prelude::*;

use super::*;
use crate::core::evidence::block::BLOCK_SIZE;
use crate::simulation::{Learner, SimulationPlan, TrainerKind, simulate};

/// Distribution of the success probability over scenarios, with a mean of 0.65.
#[derive(Debug, Clone, Copy)]
enum Spread {
    /// The same in every scenario.
    None,
    /// Uniform in [0.3, 1).
    Wide,
    /// 0 or 1, so that all episodes of a group have the same result.
    Full,
}

impl Spread {
    fn draw(self, rng: &mut KeyedRng) -> f64 {
        match self {
            Self::None => 0.65,
            Self::Wide => 0.3 + 0.7 * rng.uniform(),
            Self::Full => f64::from(u8::from(rng.bernoulli(0.65))),
        }
    }
}

/// Probability that at least `min_successes` of 32 scenarios succeed, each with probability `p`: the binomial sum.
fn block_probability(p: f64, min_successes: u32) -> f64 {
    let mut pmf = (1.0 - p).powi(32);
    let mut tail = 0.0;
    for k in 0..=32u32 {
        if k >= min_successes {
            tail += pmf;
        }
        pmf *= f64::from(32 - k) / f64::from(k + 1) * p / (1.0 - p);
    }
    tail
}

/// Probability that two consecutive blocks are good among `blocks`, each good with probability `good`.
fn two_consecutive_probability(good: f64, blocks: u32) -> f64 {
    let (mut none, mut one, mut done) = (1.0, 0.0, 0.0);
    for _ in 0..blocks {
        (none, one, done) = ((none + one) * (1.0 - good), none * good, done + one * good);
    }
    done
}

/// Share of (run, task) pairs in which a learner with 0.65 success at every level moves within this many episodes.
fn move_rate(runs: u64, episodes: u32, tasks: &[&str], group_size: u32, spread: Spread) -> f64 {
    let mut moved = 0;
    for seed in 0..runs {
        let mut run = TrainingRun { group_size, ..TrainingRun::new(seed, without_placement(tasks)) };
        for _ in 0..episodes / group_size {
            run.step(&mut |_, rng| spread.draw(rng));
        }
        moved += tasks.iter().filter(|task| run.moves.iter().any(|made| made.task == **task)).count();
    }
    moved as f64 / (runs * tasks.len() as u64) as f64
}

#[test]
fn learner_that_never_succeeds_never_moves_up() {
    for seed in 0..20 {
        let settings = if seed % 2 == 0 {
            with_placement(&[SURVIVAL, ECO])
        } else {
            without_placement(&[SURVIVAL, ECO])
        };
        let mut run = TrainingRun::new(seed, settings);
        for _ in 0..2000 {
            run.step(&mut |_, _| 0.0);
        }
        assert!(run.moves.iter().all(|made| made.to == 0), "{:?}", run.moves);
        assert_eq!(run.ups(), 0);
        assert_eq!((run.level(SURVIVAL), run.level(ECO)), (0, 0));
    }
}

/// Computes the exact rates of the rule. A block of a learner with 0.65 success is good with probability 0.036, two
/// consecutive ones about once in 800 pairs. The rate of false promotion grows with the number of blocks, and a bound on
/// it must name that number.
#[test]
fn promotion_rates_match_the_binomial_sums() {
    let good = block_probability(0.65, 26);
    assert!((good - 0.036_249_942).abs() < 1e-9, "{good}");
    // 4 096 single episodes at level 0, half of them contested: 21 blocks for each of three tasks, 64 for one alone.
    let (three, one) = (two_consecutive_probability(good, 21), two_consecutive_probability(good, 64));
    assert!((three - 0.0251).abs() < 1e-4, "{three}");
    assert!((one - 0.0770).abs() < 1e-4, "{one}");
    // From level 1 on, 70 % are at the frontier: 44 blocks for one task alone.
    let rehearsing = two_consecutive_probability(good, 44);
    assert!((rehearsing - 0.0532).abs() < 1e-4, "{rehearsing}");
    // A learner of 0.85 passes within 6 blocks, 192 contested scenarios, in 97 % of runs.
    let strong = two_consecutive_probability(block_probability(0.85, 26), 6);
    assert!((strong - 0.9738).abs() < 1e-4, "{strong}");
}

/// False promotions stay below 5 % over 4 096 episodes, for each of three tasks and for groups. A run of single episodes
/// on one task has three times the blocks and, by the exact rates above, 5 to 8 %; the simulation must agree.
#[test]
fn learner_with_0_65_success_is_rarely_promoted() {
    let three = [SURVIVAL, ECO, RENDEZVOUS];
    for spread in [Spread::None, Spread::Full] {
        let share = move_rate(250, 4096, &three, 1, spread);
        println!("three tasks, single episodes, {spread:?}: {share}");
        assert!(share < 0.05, "{share}");
    }
    for spread in [Spread::None, Spread::Wide, Spread::Full] {
        let share = move_rate(800, 4096, &[SURVIVAL], 8, spread);
        println!("one task, groups of 8, {spread:?}: {share}");
        assert!(share < 0.05, "{share}");
    }
    let share = move_rate(400, 4096, &[SURVIVAL], 1, Spread::None);
    println!("one task, single episodes: {share}");
    // Three standard deviations of 0.013 over 400 runs.
    assert!((share - 0.077).abs() < 0.040, "{share}");
}

#[test]
fn learner_with_0_85_success_moves_up_within_192_scenarios() {
    let runs = 300;
    let mut needed: Vec<u32> = (0..runs)
        .map(|seed| {
            let mut run = TrainingRun::new(seed, without_placement(&[SURVIVAL]));
            while run.moves.is_empty() {
                run.step(&mut |_, _| 0.85);
            }
            assert_eq!(run.moves[0].kind, MoveKind::Up);
            run.contested
        })
        .collect();
    needed.sort_unstable();
    let at = |share: f64| needed[(share * runs as f64) as usize];
    println!("0.85 promoted after {} (median), {} (95 %) contested scenarios", at(0.5), at(0.95));
    assert!(at(0.95) <= 192, "{}", at(0.95));
}

#[test]
fn learner_that_forgets_moves_down() {
    for seed in 0..20 {
        let mut run = TrainingRun::new(seed, without_placement(&[SURVIVAL]));
        for _ in 0..2500 {
            run.step(&mut |_, _| 0.95);
        }
        let high = run.level(SURVIVAL);
        assert!(high >= 5, "{high}");
        for _ in 0..3000 {
            run.step(&mut |_, _| 0.05);
        }
        assert!(run.level(SURVIVAL) < high, "{high}");
        assert!(
            run.moves.iter().any(|made| made.kind == MoveKind::Down && made.to + 1 == made.from.unwrap())
        );
    }
}

#[test]
fn no_task_starves_under_extreme_weights() {
    let mut settings = without_placement(&[SURVIVAL, ECO, RENDEZVOUS]);
    settings.tasks[0].weight = 1e9;
    for strategy in [StrategyKind::Ladder, StrategyKind::Uniform] {
        let settings = settings.clone().with_strategy(strategy);
        let mut curriculum = Curriculum::new(5, settings).unwrap();
        let (n, mut eco, mut rendezvous) = (80_000, 0u32, 0u32);
        for _ in 0..n {
            let SequencedProposal { proposal, .. } = curriculum.propose();
            eco += u32::from(proposal.task == ECO);
            rendezvous += u32::from(proposal.task == RENDEZVOUS);
        }
        // Five standard deviations of 62 around a mean of 4 000.
        assert!(eco.abs_diff(4000) < 310 && rendezvous.abs_diff(4000) < 310, "{eco} {rendezvous}");
    }
}

/// A trainer that reports failures as failed episodes makes every learner look perfect, and gains nothing: a failed
/// episode counts as a failure.
#[test]
fn failing_the_failures_promotes_as_little_as_honesty() {
    for (group_size, seed) in [(1, 0), (1, 1), (8, 2), (8, 3)] {
        let mut run = TrainingRun { group_size, ..TrainingRun::new(seed, without_placement(&[SURVIVAL])) };
        let mut honest = TrainingRun { group_size, ..TrainingRun::new(seed, without_placement(&[SURVIVAL])) };
        for _ in 0..3000 {
            honest.step(&mut |_, _| 0.5);
            run.step_tampered(&mut |_, _| 0.5, |outcome| {
                outcome.evidence = outcome.evidence.map(|value| SuccessInterval { high: 1.0, ..value });
                outcome.finished = outcome.successes;
            });
        }
        assert!(run.moves.is_empty() && honest.moves.is_empty(), "{:?}", run.moves);
        let status = run.status(SURVIVAL);
        assert!(status.blocks > 20, "{status:?}");
        assert!(status.warnings[0].contains("outcomes at level 0 are missing"), "{:?}", status.warnings);
        let shown = (run.curriculum.mastery()[0].clone(), honest.curriculum.mastery()[0].clone());
        assert_eq!(shown.0.mean, shown.1.mean, "the worst case is the honest success");
    }
}

#[test]
fn losing_every_episode_warns() {
    let mut run = TrainingRun::new(0, with_placement(&[SURVIVAL]));
    for _ in 0..8 {
        run.step_tampered(&mut |_, _| 1.0, |outcome| {
            (outcome.finished, outcome.successes) = (0, 0);
            outcome.evidence = Some(SuccessInterval::MISSING);
        });
    }
    let warnings = run.status(SURVIVAL).warnings;
    assert!(warnings[0].starts_with("8 of the last 8 outcomes"), "{warnings:?}");
}

/// Success of a new agent, which falls from 0.95 to 0.05 around level `middle`. That of the look-ahead policies falls
/// from 0.98 to 0.05.
fn success_curve(middle: u32) -> impl Fn(&Proposal, &mut KeyedRng) -> f64 {
    move |proposal, _| match proposal.level.unwrap() {
        level if level < middle => 0.95,
        level if level == middle => 0.75,
        level if level == middle + 1 => 0.25,
        _ => 0.05,
    }
}

#[test]
fn placement_finds_the_level_within_80_contested_scenarios() {
    let (mut right, mut runs) = (0, 0);
    for middle in 0..10 {
        for seed in 0..40 {
            let mut run = TrainingRun::new(seed, with_placement(&[SURVIVAL]));
            let mut ability = success_curve(middle);
            while run.moves.is_empty() {
                run.step(&mut ability);
            }
            assert!(run.contested <= 80, "{}", run.contested);
            assert_eq!((run.moves[0].kind, run.moves[0].from), (MoveKind::Placement, None));
            assert!(run.moves[0].to.abs_diff(middle) <= 1, "{} for {middle}", run.moves[0].to);
            right += u32::from(run.moves[0].to == middle);
            runs += 1;
        }
    }
    // 16 scenarios at 0.75 fail to reach one half in 2.7 % of probes, at 0.25 they reach it as often.
    println!("placed exactly in {right} of {runs} runs");
    assert!(f64::from(right) > 0.9 * f64::from(runs), "{right} of {runs}");
}

#[test]
fn placement_finishes_however_far_ahead_a_trainer_leases() {
    for lag in [1, 15, 16, 17, 40, 300] {
        let mut run = TrainingRun { lag, ..TrainingRun::new(9, with_placement(&[SURVIVAL])) };
        let mut ability = success_curve(6);
        for _ in 0..(lag as u32 + 16) * 5 {
            run.step(&mut ability);
        }
        assert_eq!(run.moves.first().map(|made| made.kind), Some(MoveKind::Placement), "lag {lag}");
        assert!(run.moves[0].evidence.probes.iter().all(|probe| probe.n == 16));
    }
}

#[test]
fn target_half_keeps_success_near_one_half() {
    for seed in 0..10 {
        for (group_size, lag) in [(1, 0), (8, 30)] {
            let settings = Settings { target: Target::Half, ..with_placement(&[SURVIVAL]) };
            let mut run = TrainingRun { group_size, lag, ..TrainingRun::new(seed, settings) };
            let (mut n, mut sum) = (0, 0.0);
            for step in 0..6000 {
                // From 1.0 at level 0 down to 0.1 at level 9.
                let outcome = run.step(&mut |proposal, _| 1.0 - 0.1 * f64::from(proposal.level.unwrap()));
                let frontier =
                    outcome.filter(|found| found.contested && found.role == ProposalRole::Frontier);
                if let Some(outcome) = frontier.filter(|_| step >= 1000) {
                    n += 1;
                    sum += outcome.success_rate().unwrap();
                }
            }
            let mean = sum / f64::from(n);
            assert!((0.3..=0.7).contains(&mean), "{mean}");
            assert!((2..=8).contains(&run.level(SURVIVAL)), "{}", run.level(SURVIVAL));
        }
    }
}

/// Groups that a trainer returns without beginning them cost nothing.
#[test]
fn returning_unbegun_groups_leaves_the_level_as_it_is() {
    let levels = |trainer| -> Vec<u32> {
        let level = |seed| {
            let settings = Settings { target: Target::Mastery, ..without_placement(&[SURVIVAL]) };
            let plan =
                SimulationPlan { settings, trainer, episodes: 1000, group_size: 1, queue_length: 16, seed };
            let trace = simulate(&plan, Learner::constant(0.9)).unwrap();
            trace.status[0].level.unwrap()
        };
        let mut levels: Vec<u32> = (0..2000).into_par_iter().map(level).collect();
        levels.sort_unstable();
        levels
    };
    let (honest, returning) = (levels(TrainerKind::Honest), levels(TrainerKind::ReturnsUnbegun));
    let mean = |levels: &[u32]| levels.iter().sum::<u32>() as f64 / levels.len() as f64;
    println!(
        "mean level {:.3} with every group, {:.3} without those returned",
        mean(&honest),
        mean(&returning)
    );
    assert_eq!(honest[1000], returning[1000]);
    assert!((mean(&honest) - mean(&returning)).abs() < 0.2);
    assert!(mean(&honest) > 1.0, "the levels rise");
}

/// Few episodes lost at random delay a promotion little.
#[test]
fn random_losses_cost_at_most_one_block() {
    let mean_blocks = |loss: f64| -> f64 {
        let blocks = |seed| {
            let mut run = TrainingRun::new(seed, without_placement(&[SURVIVAL]));
            let mut losses = KeyedRng::new(RngPurpose::Simulation, seed, 9);
            while run.moves.is_empty() {
                let is_lost = losses.bernoulli(loss);
                run.step_tampered(&mut |_, _| 0.9, |outcome| {
                    if is_lost {
                        outcome.evidence = outcome.evidence.map(|_| SuccessInterval::MISSING);
                    }
                });
            }
            f64::from(run.contested) / f64::from(BLOCK_SIZE)
        };
        (0..2000u64).into_par_iter().map(blocks).sum::<f64>() / 2000.0
    };
    let (without, with) = (mean_blocks(0.0), mean_blocks(0.05));
    println!("blocks to a promotion at 0.9: {without:.2} without losses, {with:.2} with 5 %");
    assert!(with - without <= 1.0, "{without} {with}");
}
