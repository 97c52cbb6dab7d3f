//! Every target on 25 000 mutated inputs, or on 100 000 with `SPARRING_LONG_TESTS`. `SPARRING_FUZZ_INPUTS` sets another number,
//! `SPARRING_FUZZ_SEED` draws other inputs.

mod driver;
mod tasking;

use std::path::Path;

use fuzz_targets::driver::{Plan, TIMEOUT, fuzz};
use fuzz_targets::{TARGETS, find};

/// Number of inputs of each target.
const INPUTS: u64 = 25_000;
/// Number of inputs of each target in long tests.
const LONG_INPUTS: u64 = 100_000;

fn variable(name: &str) -> Option<u64> {
    let text = std::env::var(name).ok()?;
    Some(text.parse().unwrap_or_else(|_| panic!("{name} must be a whole number, got {text:?}")))
}

/// Runs a target and returns a line about it. Panics at the first failing input, after it is saved.
fn run(name: &str) -> String {
    let target = find(name).unwrap_or_else(|| panic!("there is no target {name}"));
    let is_long = std::env::var_os("SPARRING_LONG_TESTS").is_some();
    let inputs = if is_long { LONG_INPUTS } else { INPUTS };
    let plan = Plan {
        inputs: variable("SPARRING_FUZZ_INPUTS").unwrap_or(inputs) / target.divisor,
        seed: variable("SPARRING_FUZZ_SEED").unwrap_or(0),
        timeout: TIMEOUT,
    };
    let started = std::time::Instant::now();
    match fuzz(target, plan) {
        Ok(summary) => format!("{name}: {summary:?} in {:.1?}", started.elapsed()),
        Err(failure) => {
            let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/fuzz-failures");
            let path = failure.save(&folder).expect("target/ can be written");
            panic!("{failure}\nThe input is in {}.", path.display());
        }
    }
}

/// Defines a test for each target.
macro_rules! tests {
    ($($name:ident)*) => {
        $(
            #[test]
            fn $name() {
                println!("{}", run(stringify!($name)));
            }
        )*

        #[test]
        fn every_target_has_a_test() {
            let targets: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
            let tests = [$(stringify!($name)),*];
            assert_eq!(targets, tests, "a target has no test, or its place in the list differs");
        }
    };
}

tests! {
    json messagepack query requests
    python_json lax_numbers actions
    scenario action_log log_steps observation
    tasking_recording tasking_episode
    frame session_message columns_json columns_messagepack results reset_request rpc query_words body
    ids words token stored_log stored_bracket compacted_leases stored_columns stored_group
    settings snapshot curriculum_events suite_file
    design design_docking design_tasking design_answer failure_profile layout_file
    chat_response retry_after json_in_text reply verdict
    arguments bind server_address nats_url config event_stream server_message actions_file
    policy_reference reflex_file onnx_file
    job_envelope result_envelope prepare_job prepare_result audit_job audit_result critique_job critique_result
    design_job design_result rollout_job rollout_result heartbeat control_message run_state
}

#[test]
fn every_target_has_a_binary_for_libfuzzer() {
    let manifest = include_str!("../../../fuzz/Cargo.toml");
    let binaries: Vec<&str> =
        manifest.split("[[bin]]\nname = \"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    let targets: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
    assert_eq!(binaries, targets, "fuzz/Cargo.toml differs from the list of targets");
}
