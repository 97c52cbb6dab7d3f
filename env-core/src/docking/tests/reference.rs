//! Compares with recorded episodes of safe-autonomy-sims.

use serde_json::{Value, json};

use crate::testing::decompress;
use crate::world::RecordingComparison;

/// Tolerance of states (in m) and reward components. Φ and Γ differ from the recording's only by rounding, about 1e-16 of
/// 100 m per step, growing over up to 2000 steps.
const TOLERANCE: f64 = 1e-9;

fn compare(recording: &Value) -> RecordingComparison {
    let found: Vec<_> =
        crate::worlds().filter_map(|world| world.compare_recording(recording, TOLERANCE)).collect();
    assert_eq!(found.len(), 1, "exactly one world recognises it");
    found.into_iter().next().unwrap().unwrap()
}

fn edge_cases() -> Value {
    decompress(include_bytes!("../../../fixtures/docking-edge.json.gz"))
}

fn print(name: &str, found: &RecordingComparison) {
    println!("{name}: {} episodes, {} steps", found.episodes, found.steps);
    for worst in &found.worst {
        println!("  {}: {:.2e} of {:.2e}", worst.quantity, worst.difference, worst.allowed);
    }
    found.documented.iter().for_each(|why| println!("  {why}"));
}

#[test]
fn validate_safe_autonomy_docks() {
    let found = compare(&decompress(include_bytes!("../../../fixtures/docking-docks.json.gz")));
    print("docks", &found);
    assert_eq!((found.first, found.documented.len(), found.steps), (None, 0, 524));
}

#[test]
fn validate_safe_autonomy_random() {
    let found = compare(&decompress(include_bytes!("../../../fixtures/docking-random.json.gz")));
    print("random", &found);
    assert_eq!((found.first, found.documented.len(), found.steps), (None, 0, 512 + 782));
}

#[test]
fn validate_safe_autonomy_edge_cases() {
    let found = compare(&edge_cases());
    print("edge", &found);
    assert_eq!((found.first, found.documented.len()), (None, 1));
}

#[test]
fn validate_safe_autonomy_timeouts() {
    let found = compare(&decompress(include_bytes!("../../../fixtures/docking-timeout.json.gz")));
    print("timeout", &found);
    assert_eq!((found.first, found.documented.len(), found.steps), (None, 1, 16));
}

/// A change of one number, flag, reason or action is reported.
#[test]
fn changed_recording_differs() {
    let changed = |path: &str, value: Value| {
        let mut recording = edge_cases();
        *recording.pointer_mut(path).unwrap() = value;
        let first = compare(&recording).first.unwrap();
        (first.episode, first.step)
    };
    let agent = |rest: &str| format!("/episodes/5/steps/9/agents/blue0_ctrl/{rest}");
    assert_eq!(changed(&agent("components/DockingVelocityConstraintReward"), json!(-0.05)), (5, 10));
    assert_eq!(changed(&agent("obs/3"), json!(0.5)), (5, 10));
    assert_eq!(changed(&agent("done"), json!(true)), (5, 10));
    assert_eq!(changed(&agent("action/0"), json!(1e-3)), (5, 10));
    assert_eq!(changed("/episodes/0/steps/0/agents/blue0_ctrl/done_info/0", json!("Timeout")), (0, 1));
    assert_eq!(changed("/episodes/2/steps/2/all_done", json!(false)), (2, 3));
    assert_eq!(changed("/episodes/4/init_state/blue0_ctrl/1", json!(2e-9)).0, 4);
}

#[test]
fn malformed_recording_is_a_typed_error() {
    let wrong = json!({"episodes": [{"init_state": {}, "steps": [{"agents": {}}]}]});
    assert!(crate::world("docking").unwrap().compare_recording(&wrong, TOLERANCE).unwrap().is_err());
    let mut short = decompress(include_bytes!("../../../fixtures/docking-timeout.json.gz"));
    short["episodes"][0]["note"] = Value::Null;
    let error = crate::world("docking").unwrap().compare_recording(&short, TOLERANCE).unwrap().unwrap_err();
    assert_eq!(error.to_string(), "episode 0: it lists 8 of 2000 steps, and does not state which");
}
