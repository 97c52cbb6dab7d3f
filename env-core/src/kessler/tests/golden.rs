//! Golden hashes: no later speed-up moves a bit.

use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::TASKS;
use crate::log::{ActionLog, Precision};
use crate::seed::Seed;
use crate::testing::{brackets, final_states};

/// Burns on a third of the steps, from a seed.
fn scripted_log(seed: u64) -> ActionLog {
    let mut chance = Seeded::new(Seed::user(seed).unwrap());
    let mut log = ActionLog::new(2, Precision::F64);
    for _ in 0..50 {
        for satellite in 0..3 {
            if chance.uniform(Stream::Policy) < 0.33 {
                let burn = [0, 1].map(|_| chance.between(Stream::Policy, -0.2, 0.2));
                log.act(satellite, &burn);
            }
        }
        log.end_step();
    }
    log
}

#[test]
fn regress_golden_final_states() {
    insta::assert_debug_snapshot!(final_states(&TASKS, |_, seed| scripted_log(seed)));
}

/// Brackets rest on the planner's version: a change here without a new version is a mistake.
#[test]
fn regress_golden_brackets() {
    insta::assert_debug_snapshot!(brackets(&TASKS, &[0, 4, 7]));
}
