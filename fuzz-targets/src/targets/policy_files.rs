//! Policies from files: their references, reflexes, and ONNX models.

use env_core::TaskSpec;
use env_core::policy_factory::PolicyFactory;
use policy_files::{OnnxPolicy, PolicyReference, ReflexPolicy};
use serde_json::json;

use crate::target::{Target, json_seeds, seeds_of, with_text};

pub(super) const TARGETS: &[Target] = &[
    Target::new("policy_reference", reference, reference_seeds),
    Target::new("reflex_file", reflex, reflex_seeds),
    Target::new("onnx_file", onnx, onnx_seeds),
];

/// A reference is written as it was read.
fn reference(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let reference = PolicyReference::parse(text);
        assert_eq!(reference.to_string(), text, "the written reference differs");
        reference.is_file()
    })
}

fn reference_seeds() -> Vec<Vec<u8>> {
    seeds_of(&["onnx:model.onnx", "onnx:model@v2.onnx", "reflex:demo.json@0123456789ab"])
}

/// Accepted parameters are those of a reflex.
fn reflex(bytes: &[u8]) -> bool {
    let Ok(policy) = ReflexPolicy::parse("reflex:f".to_owned(), bytes) else { return false };
    assert!(env_core::tasks().any(|task| policy.check(task).is_ok()), "the file has a reflex of no task");
    true
}

fn reflex_seeds() -> Vec<Vec<u8>> {
    let file = |task: &dyn TaskSpec| json!({"seed": 1, "tasks": {task.id(): {"level": 2, "numbers": vec![0.5; task.reflex().names.len()]}}});
    json_seeds(env_core::tasks().map(file))
}

/// A damaged model is refused or read, but it never ends the process. Tests of `policy-files` also prepare damaged models, which is too
/// slow for this many.
fn onnx(bytes: &[u8]) -> bool {
    OnnxPolicy::parse("onnx:f".to_owned(), bytes).is_ok()
}

fn onnx_seeds() -> Vec<Vec<u8>> {
    let small = include_bytes!("../../../tests/fixtures/onnx/faulty/no_metadata.onnx");
    let large = include_bytes!("../../../tests/fixtures/onnx/tracks_discrete.onnx");
    vec![small.to_vec(), large.to_vec()]
}
