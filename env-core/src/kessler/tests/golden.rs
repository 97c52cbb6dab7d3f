//! Golden hashes: no optimisation changes a bit.

use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::kessler::KESSLER_TASKS;
use crate::log::{ActionLog, Precision};
use crate::seed::Seed;
use crate::testing::{brackets, final_states};

/// Log with burns on a third of the steps, drawn from a seed.
fn scripted_log(seed: u64) -> ActionLog {
    let mut rng = SeededRng::new(Seed::user(seed).unwrap());
    let mut log = ActionLog::new(2, Precision::F64);
    for _ in 0..50 {
        for satellite in 0..3 {
            if rng.uniform(RngStream::Policy) < 0.33 {
                let burn = [0, 1].map(|_| rng.uniform_in(RngStream::Policy, -0.2, 0.2));
                log.push_entry(satellite, &burn);
            }
        }
        log.end_step();
    }
    log
}

#[test]
fn regress_golden_final_states() {
    insta::assert_debug_snapshot!(final_states(&KESSLER_TASKS, |_, seed| scripted_log(seed)));
}

/// Stored brackets depend on the planner's version: a change here requires a new version.
#[test]
fn regress_golden_brackets() {
    insta::assert_debug_snapshot!(brackets(&KESSLER_TASKS, &[0, 4, 7]));
}
