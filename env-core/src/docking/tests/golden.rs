//! Golden hashes: no later speed-up moves a bit.

use crate::chance::{Chance, Seeded, Stream};
use crate::docking::TASKS;
use crate::log::{ActionLog, Precision};
use crate::rollout::fly;
use crate::scenario::Scenario;
use crate::seed::Seed;
use crate::testing::{brackets, final_states};

/// The pilot's thrusts, a tenth of them replaced by chance: long episodes with every kind of number in them.
fn disturbed(scenario: &Scenario, seed: u64) -> ActionLog {
    let mut pilot = scenario.task().policy("heuristic", scenario, 0).unwrap();
    let (_, flown) = fly(scenario, pilot.as_mut()).unwrap();
    let mut chance = Seeded::new(Seed::user(seed).unwrap());
    let mut log = ActionLog::new(3, Precision::F64);
    for step in flown.steps() {
        for (&agent, thrust) in step.agents.iter().zip(step.values.chunks_exact(3)) {
            if chance.uniform(Stream::Policy) < 0.1 {
                log.act(agent, &[0, 1, 2].map(|_| chance.between(Stream::Policy, -1.0, 1.0)));
            } else {
                log.act(agent, thrust);
            }
        }
        log.end_step();
    }
    log.stopped = Some(crate::Stopped::TooLate);
    log
}

#[test]
fn regress_golden_final_states() {
    insta::assert_debug_snapshot!(final_states(&TASKS, disturbed));
}

/// Brackets rest on the planner's version: a change here without a new version is a mistake.
#[test]
fn regress_golden_brackets() {
    insta::assert_debug_snapshot!(brackets(&TASKS, &[0, 4, 7, 9]));
}
