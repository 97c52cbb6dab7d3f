//! Golden hashes: no optimisation may change a bit.

use crate::docking::DOCKING_TASKS;
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::log::{ActionLog, Precision};
use crate::rollout::roll_out;
use crate::seed::Seed;
use crate::task::Scenario;
use crate::testing::{brackets, final_states};

/// The heuristic policy's thrusts, a tenth of them replaced at random: long episodes with every kind of value.
fn disturbed_log(scenario: &Scenario, seed: u64) -> ActionLog {
    let mut policy = scenario.task().policy("heuristic", scenario, 0).unwrap();
    let log_of_policy = roll_out(scenario, policy.as_mut()).unwrap().log;
    let mut rng = SeededRng::new(Seed::user(seed).unwrap());
    let mut log = ActionLog::new(3, Precision::F64);
    for step in log_of_policy.steps() {
        for (&agent, thrust) in step.agents.iter().zip(step.values.chunks_exact(3)) {
            if rng.uniform(RngStream::Policy) < 0.1 {
                log.push_entry(agent, &[0, 1, 2].map(|_| rng.uniform_in(RngStream::Policy, -1.0, 1.0)));
            } else {
                log.push_entry(agent, thrust);
            }
        }
        log.end_step();
    }
    log.stopped = Some(crate::StopReason::TooLate);
    log
}

#[test]
fn regress_golden_final_states() {
    insta::assert_debug_snapshot!(final_states(&DOCKING_TASKS, disturbed_log));
}

/// A change of these brackets requires a new planner version.
#[test]
fn regress_golden_brackets() {
    insta::assert_debug_snapshot!(brackets(&DOCKING_TASKS, &[0, 4, 7, 9]));
}
