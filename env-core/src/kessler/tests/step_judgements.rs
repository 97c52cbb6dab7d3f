//! Deterministic judgements of single steps.

use proptest::prelude::*;

use crate::critique::Judgement;
use crate::log::{ActionLog, Precision};
use crate::rollout::{Rollout, roll_out};
use crate::task::Scenario;
use crate::testing::at_level;

/// Judgement of every step of a log.
fn judge_steps(scenario: &Scenario, log: &ActionLog) -> Vec<Judgement> {
    let mut so_far = ActionLog::new(2, Precision::F64);
    let mut judgements = Vec::new();
    for step in log.steps() {
        for (agent, values) in step.agents.iter().zip(step.values.chunks_exact(2)) {
            so_far.push_entry(*agent, values);
        }
        so_far.end_step();
        judgements.push(scenario.task().judge_step(scenario, &so_far).unwrap().unwrap());
    }
    judgements
}

fn roll_out_policy(scenario: &Scenario, policy: &str) -> (crate::EpisodeOutcome, ActionLog) {
    let Rollout { outcome, log } =
        roll_out(scenario, &mut *scenario.task().policy(policy, scenario, 0).unwrap()).unwrap();
    (outcome, log)
}

/// Judgements of hold in survival. If no satellite is lost, every step has the best value. If a satellite
/// that could have been saved is lost, that step has the worst value, and the steps before count down to it.
/// The reference has a needed burn there.
#[test]
fn hold_is_judged_by_the_threats_to_come() {
    let (mut quiet, mut missed, mut rewarded) = (0, 0, 0);
    for seed in 0..40 {
        let scenario = at_level("kessler/survival", 4, seed);
        let (held, log) = roll_out_policy(&scenario, "hold");
        let judgements = judge_steps(&scenario, &log);
        if held.lost == 0 {
            quiet += 1;
            assert!(
                judgements
                    .iter()
                    .all(|judgement| (judgement.value, judgement.case) == (1.0, "no_action_needed")),
                "{seed}"
            );
            continue;
        }
        let Some(at) = judgements.iter().position(|judgement| judgement.case == "threat_missed") else {
            continue;
        };
        missed += 1;
        assert_eq!(judgements[at].value, -1.0);
        // Pending threats count down, one step after another.
        for back in 1..=3.min(at) {
            let judgement = &judgements[at - back];
            if judgement.case == "threat_waits" {
                assert!(judgement.value <= -0.25 * (4 - back) as f64, "{seed}: {judgement:?}");
            }
        }
        assert!(at == 0 || judgements[at - 1].value < 0.0, "{seed}: {:?}", judgements[at - 1]);
        let (saved, plan) = roll_out_policy(&scenario, "reference");
        if saved.lost == 0 {
            let best = judge_steps(&scenario, &plan);
            rewarded += u32::from(
                best.iter().any(|judgement| judgement.case == "needed_burn" && judgement.value >= 0.8),
            );
            assert!(!best.iter().any(|judgement| judgement.case == "threat_missed"), "{seed}");
        }
    }
    assert!(quiet >= 3 && missed >= 10 && rewarded >= 8, "{quiet} {missed} {rewarded}");
}

#[test]
fn unnecessary_burn_is_penalised_by_its_fuel() {
    let seed = (0..)
        .find(|&seed| roll_out_policy(&at_level("kessler/survival", 0, seed), "hold").0.lost == 0)
        .unwrap();
    let scenario = at_level("kessler/survival", 0, seed);
    let judgement = |burn: f64| {
        let mut log = ActionLog::new(2, Precision::F64);
        log.push_entry(0, &[burn, 0.0]);
        log.end_step();
        scenario.task().judge_step(&scenario, &log).unwrap().unwrap()
    };
    let small = judgement(0.01);
    assert_eq!(small.case, "unnecessary_burn");
    let fuel = 3.0 * 100.0;
    assert!((small.value - (-0.5 - 0.5 * 0.05 / fuel)).abs() < 1e-12, "{small:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Every step of any episode has a judgement in range, and judging is deterministic.
    #[test]
    fn every_step_has_a_judgement(level in 0usize..10, seed in 0u64..1000, task in 0usize..4, steps in 1usize..12) {
        let id = ["kessler/survival", "kessler/eco_station", "kessler/rendezvous", "kessler/formation"][task];
        let scenario = at_level(id, level, seed);
        let (_, mut log) = roll_out_policy(&scenario, "random");
        log.truncate(steps.min(log.len()));
        let once = scenario.task().judge_step(&scenario, &log).unwrap().unwrap();
        prop_assert!((-1.0..=1.0).contains(&once.value), "{:?}", once);
        prop_assert_eq!(scenario.task().judge_step(&scenario, &log).unwrap().unwrap(), once);
    }
}
