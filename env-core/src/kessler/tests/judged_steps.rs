//! The deterministic judge's word on single steps.

use proptest::prelude::*;

use crate::critique::Judged;
use crate::log::{ActionLog, Precision};
use crate::rollout::fly;
use crate::scenario::Scenario;
use crate::testing::at_level;

/// Its word on every step of a log.
fn words(scenario: &Scenario, log: &ActionLog) -> Vec<Judged> {
    let mut so_far = ActionLog::new(2, Precision::F64);
    let mut words = Vec::new();
    for step in log.steps() {
        for (agent, values) in step.agents.iter().zip(step.values.chunks_exact(2)) {
            so_far.act(*agent, values);
        }
        so_far.end_step();
        words.push(scenario.task().judge_step(scenario, &so_far).unwrap().unwrap());
    }
    words
}

fn flown(scenario: &Scenario, policy: &str) -> (crate::Flown, ActionLog) {
    fly(scenario, &mut *scenario.task().policy(policy, scenario, 0).unwrap()).unwrap()
}

/// Over seeds of survival: where holding loses nobody each step is as good as can be; where it loses somebody who could
/// have been saved, that step is as bad as can be, and those before it count down; what the reference does instead is
/// praised for at least one burn.
#[test]
fn holding_is_judged_by_what_comes() {
    let (mut quiet, mut missed, mut praised) = (0, 0, 0);
    for seed in 0..40 {
        let scenario = at_level("kessler/survival", 4, seed);
        let (held, log) = flown(&scenario, "hold");
        let said = words(&scenario, &log);
        if held.lost == 0 {
            quiet += 1;
            assert!(said.iter().all(|word| (word.value, word.case) == (1.0, "no_action_needed")), "{seed}");
            continue;
        }
        let Some(at) = said.iter().position(|word| word.case == "threat_missed") else { continue };
        missed += 1;
        assert_eq!(said[at].value, -1.0);
        // Those that wait count down to it, one step after another.
        for back in 1..=3.min(at) {
            let word = &said[at - back];
            if word.case == "threat_waits" {
                assert!(word.value <= -0.25 * (4 - back) as f64, "{seed}: {word:?}");
            }
        }
        assert!(at == 0 || said[at - 1].value < 0.0, "{seed}: {:?}", said[at - 1]);
        let (saved, plan) = flown(&scenario, "reference");
        if saved.lost == 0 {
            let best = words(&scenario, &plan);
            praised += u32::from(best.iter().any(|word| word.case == "needed_burn" && word.value >= 0.8));
            assert!(!best.iter().any(|word| word.case == "threat_missed"), "{seed}");
        }
    }
    assert!(quiet >= 3 && missed >= 10 && praised >= 8, "{quiet} {missed} {praised}");
}

#[test]
fn burning_for_nothing_is_blamed_by_the_fuel() {
    let seed = (0..).find(|&seed| flown(&at_level("kessler/survival", 0, seed), "hold").0.lost == 0).unwrap();
    let scenario = at_level("kessler/survival", 0, seed);
    let word = |burn: f64| {
        let mut log = ActionLog::new(2, Precision::F64);
        log.act(0, &[burn, 0.0]);
        log.end_step();
        scenario.task().judge_step(&scenario, &log).unwrap().unwrap()
    };
    let small = word(0.01);
    assert_eq!(small.case, "unnecessary_burn");
    let fuel = 3.0 * 100.0;
    assert!((small.value - (-0.5 - 0.5 * 0.05 / fuel)).abs() < 1e-12, "{small:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Whatever is flown, every step has a word within its range, and the same twice.
    #[test]
    fn every_step_has_a_word(level in 0usize..10, seed in 0u64..1000, task in 0usize..4, steps in 1usize..12) {
        let id = ["kessler/survival", "kessler/eco_station", "kessler/rendezvous", "kessler/formation"][task];
        let scenario = at_level(id, level, seed);
        let (_, mut log) = flown(&scenario, "random");
        log.truncate(steps.min(log.len()));
        let once = scenario.task().judge_step(&scenario, &log).unwrap().unwrap();
        prop_assert!((-1.0..=1.0).contains(&once.value), "{:?}", once);
        prop_assert_eq!(scenario.task().judge_step(&scenario, &log).unwrap().unwrap(), once);
    }
}
