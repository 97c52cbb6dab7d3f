//! Laws of what strategies say about their next draws.

use env_core::keyed_rng::{KeyedRng, RngPurpose};

use super::create;
use crate::core::rungs::{RungKind, RungScale};
use crate::core::sampler_state::SamplerOutlook;
use crate::core::strategy::{Strategy, StrategyContext};
use crate::{Curriculum, GroupOutcome, Hyperparameters, LearningSignals, Settings, StrategyKind, TaskPlan};

const DOCKING: &str = "docking/single";
const SURVIVAL: &str = "kessler/survival";
const RENDEZVOUS: &str = "kessler/rendezvous";
/// Number of run seeds for which a strategy makes its next proposal.
const SEEDS: u32 = 4000;

fn settings(strategy: StrategyKind, task: &str, hyperparameters: &str) -> Settings {
    let hyperparameters = serde_json::from_str(hyperparameters).unwrap();
    Settings {
        hyperparameters: Hyperparameters::parse(strategy, &hyperparameters).unwrap(),
        ..Settings::ladder(vec![TaskPlan::standard(task).unwrap()]).with_strategy(strategy)
    }
}

/// Strategy after a number of groups of four episodes, whose success falls and whose length grows with the difficulty.
fn trained(settings: &Settings, groups: u64) -> Box<dyn Strategy> {
    let mut strategy = create(settings);
    let mut rng = KeyedRng::new(RngPurpose::Simulation, 3, groups);
    for at in 0..groups {
        let ctx = StrategyContext { settings, run_seed: 7, seq: 2 * at };
        let proposal = strategy.propose(&ctx);
        let rung = f64::from(proposal.start_rung.or(proposal.level).unwrap());
        let success = 1.0 / (1.0 + libm::exp(0.7 * (rung - 4.0)));
        let successes = (0..4).map(|_| u32::from(rng.bernoulli(success))).sum();
        let outcome = GroupOutcome {
            finished: 4,
            successes,
            usable: true,
            steps: 4 * (40 + 30 * u64::from(proposal.start_rung.unwrap_or(1))),
            signals: LearningSignals { regret: Some(1.0 - success), ..LearningSignals::default() },
            ..GroupOutcome::missing(2 * at, 0, &proposal)
        };
        strategy.observe(&outcome, &StrategyContext { seq: 2 * at + 1, ..ctx });
    }
    strategy
}

fn outlook(strategy: &dyn Strategy, settings: &Settings, groups: u64) -> SamplerOutlook {
    strategy.sampler(&settings.tasks[0], &StrategyContext { settings, run_seed: 7, seq: 2 * groups })
}

/// Shares of the rungs in the next proposals of copies of a strategy, under many run seeds.
fn drawn_shares(strategy: &dyn Strategy, settings: &Settings, kind: RungKind, groups: u64) -> Vec<f64> {
    let mut shares = vec![0.0; RungScale::new(&settings.tasks[0]).count(kind) as usize];
    for run_seed in 0..u64::from(SEEDS) {
        let ctx = StrategyContext { settings, run_seed, seq: 2 * groups };
        let proposal = strategy.boxed_clone().propose(&ctx);
        let rung = if kind == RungKind::Start { proposal.start_rung } else { proposal.level };
        shares[rung.unwrap() as usize] += 1.0 / f64::from(SEEDS);
    }
    shares
}

#[test]
fn probabilities_are_those_of_the_next_proposal() {
    let accel = r#"{"filled": 8, "edited": 1.0}"#;
    let cases = [
        (StrategyKind::Staircase, DOCKING, r#"{"coverage": 0.3}"#, RungKind::Start),
        (StrategyKind::Staircase, SURVIVAL, "{}", RungKind::Level),
        (StrategyKind::Controller, DOCKING, r#"{"coverage": 0.3, "width": 2.3}"#, RungKind::Start),
        (StrategyKind::Controller, SURVIVAL, r#"{"width": 0.0}"#, RungKind::Level),
        (StrategyKind::Bandit, DOCKING, "{}", RungKind::Start),
        (StrategyKind::Auto, DOCKING, "{}", RungKind::Start),
        (StrategyKind::Auto, RENDEZVOUS, "{}", RungKind::Level),
        (StrategyKind::Uniform, SURVIVAL, "{}", RungKind::Level),
        (StrategyKind::Learnability, SURVIVAL, "{}", RungKind::Level),
        (StrategyKind::Learnability, SURVIVAL, r#"{"rank": "rollouts", "candidates": 8}"#, RungKind::Level),
        (StrategyKind::Plr, SURVIVAL, r#"{"filled": 8}"#, RungKind::Level),
        (StrategyKind::Plr, SURVIVAL, r#"{"filled": 1000}"#, RungKind::Level),
        (StrategyKind::Accel, SURVIVAL, accel, RungKind::Level),
    ];
    for (strategy, task, hyperparameters, kind) in cases {
        let settings = settings(strategy, task, hyperparameters);
        for groups in [0, 1, 150] {
            let trained = trained(&settings, groups);
            let outlook = outlook(&*trained, &settings, groups);
            assert_eq!(outlook.kind, Some(kind), "{strategy} {task}");
            let expected = outlook.probabilities.unwrap();
            assert!((expected.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{strategy} {task}: {expected:?}");
            let drawn = drawn_shares(&*trained, &settings, kind, groups);
            for (rung, (expected, drawn)) in expected.iter().zip(&drawn).enumerate() {
                // Five standard deviations of the share.
                let bound = 5.0 * (expected * (1.0 - expected) / f64::from(SEEDS)).sqrt() + 1e-9;
                assert!(
                    (expected - drawn).abs() <= bound,
                    "{strategy} {task} after {groups}, rung {rung}: {expected} {drawn}"
                );
            }
        }
    }
}

/// An edit that waits for its turn decides the next level.
#[test]
fn waiting_edit_has_all_of_the_probability() {
    let settings = settings(StrategyKind::Accel, SURVIVAL, r#"{"filled": 8, "edited": 1.0, "replay": 1.0}"#);
    let certain = |groups: &u64| {
        let probabilities = outlook(&*trained(&settings, *groups), &settings, *groups).probabilities.unwrap();
        probabilities.contains(&1.0)
    };
    assert!((100..110).any(|groups| certain(&groups)));
}

#[test]
fn chains_are_counted_at_their_rungs() {
    let settings = settings(StrategyKind::Staircase, DOCKING, r#"{"chains": 12}"#);
    for (groups, at_easiest) in [(0, true), (400, false)] {
        let outlook = outlook(&*trained(&settings, groups), &settings, groups);
        let chains = outlook.chains.unwrap();
        assert_eq!((chains.len(), chains.iter().sum::<u32>()), (16, 12));
        assert_eq!(chains[0] == 12, at_easiest, "{chains:?}");
        assert_eq!(outlook.quartiles.is_some(), !at_easiest);
    }
}

#[test]
fn every_strategy_has_a_sampler_for_each_task() {
    for strategy in StrategyKind::ALL {
        let plans = [SURVIVAL, DOCKING].map(|task| TaskPlan::standard(task).unwrap());
        let settings = Settings::ladder(plans.to_vec()).with_strategy(strategy);
        let mut curriculum = Curriculum::new(3, settings).unwrap();
        for _ in 0..600 {
            let proposed = curriculum.propose();
            let finished = GroupOutcome {
                finished: 2,
                successes: 1,
                usable: true,
                ..GroupOutcome::missing(proposed.seq, 0, &proposed.proposal)
            };
            curriculum.observe(&finished);
        }
        let samplers = curriculum.samplers();
        assert_eq!(samplers.iter().map(|of| of.task.as_str()).collect::<Vec<_>>(), [SURVIVAL, DOCKING]);
        for (sampler, rungs) in samplers.iter().zip([10, 16]) {
            assert!(!sampler.state.is_empty(), "{strategy}");
            assert_eq!(sampler.proposals, 256, "{strategy}");
            assert_eq!(sampler.reason.is_some(), strategy == StrategyKind::Auto);
            assert_eq!(sampler.name == strategy.name(), strategy != StrategyKind::Auto);
            let draws_params =
                matches!(strategy, StrategyKind::Fixed | StrategyKind::Adr | StrategyKind::AlpGmm);
            assert_eq!((sampler.kind.is_none(), sampler.rungs.is_empty()), (draws_params, draws_params));
            if draws_params {
                continue;
            }
            assert_eq!(sampler.rungs.len(), if strategy.samples_rungs() { rungs } else { 10 }, "{strategy}");
            assert_eq!(sampler.rungs.iter().map(|rung| rung.draws).sum::<u32>(), 256, "{strategy}");
            for rung in &sampler.rungs {
                assert!((rung.successes - rung.attempts / 2.0).abs() < 1e-9, "{strategy}: {rung:?}");
                assert_eq!(rung.start_scale.is_some(), sampler.kind == Some(RungKind::Start));
            }
        }
    }
}
