//! Scenarios, recipes with layouts, action logs and observations of all worlds.

use std::sync::LazyLock;

use env_core::log::{ActionLog, Precision};
use env_core::rollout::read_log;
use env_core::{Recipe, Scenario, Seed, TaskSpec};
use serde_json::{Value, json};

use crate::target::{Target, json_seeds, with_json};

pub(super) const TARGETS: &[Target] = &[
    Target::new("scenario", scenario, scenario_seeds),
    Target::new("action_log", action_log, log_seeds),
    Target::new("log_steps", log_steps, step_seeds),
    Target::new("observation", observation, observation_seeds),
];

/// A scenario or recipe is the same after it is written and parsed again, with the same id. Errors have bounded length.
fn scenario(bytes: &[u8]) -> bool {
    with_json(bytes, |value| {
        let recipe = Recipe::from_json(&value);
        if let Ok(recipe) = &recipe {
            let again = Recipe::from_json(&recipe.to_json()).expect("the written recipe is valid");
            assert_eq!(again.canonical(), recipe.canonical(), "the written recipe differs");
        }
        match Scenario::from_json(&value) {
            Ok(scenario) => {
                let again = Scenario::from_json(&scenario.to_json()).expect("the written scenario is valid");
                assert_eq!(again.id(), scenario.id(), "the written scenario differs");
                assert!(scenario.recipe().params().iter().all(|param| param.is_finite()));
                true
            }
            Err(error) => {
                let length = error.to_string().len();
                assert!(length < 8192, "the error has {length} bytes");
                recipe.is_ok()
            }
        }
    })
}

/// A decoded log encodes to the same bytes.
fn action_log(bytes: &[u8]) -> bool {
    let Ok(log) = ActionLog::decode(bytes) else { return false };
    let encoded = log.encode();
    // The bits of a NaN in single precision are not kept.
    if log.steps().all(|step| step.values.iter().all(|value| !value.is_nan())) {
        assert_eq!(encoded, bytes, "the encoded log differs");
    }
    assert_eq!(log.steps().count(), log.len());
    true
}

/// Returns one scenario of each world.
fn scenarios() -> &'static [Scenario] {
    static SCENARIOS: LazyLock<Vec<Scenario>> = LazyLock::new(|| {
        // Observations of few bodies are short, so that more of them are parsed.
        let has_debris = |task: &dyn TaskSpec| task.params().iter().any(|param| param.name == "debris");
        let recipe = |task: &'static dyn TaskSpec| {
            let params = has_debris(task).then_some(("debris", 3.0));
            Recipe::with_params(task, params.into_iter()).expect("the params are within their ranges")
        };
        let seed = Seed::new(7).expect("7 is a seed");
        first_tasks().map(|task| Scenario::new(recipe(task), seed)).collect()
    });
    &SCENARIOS
}

fn first_tasks() -> impl Iterator<Item = &'static dyn TaskSpec> {
    env_core::worlds().filter_map(|world| world.tasks().first().copied())
}

/// A log that was read is the same after it is encoded and decoded, and has as many steps as the JSON.
fn log_steps(bytes: &[u8]) -> bool {
    with_json(bytes, |value| {
        let Value::Array(steps) = value else { return false };
        let read = |scenario: &Scenario, precision| match read_log(scenario, &steps, precision, None) {
            Ok(log) => {
                assert_eq!(log.len(), steps.len());
                assert_eq!(ActionLog::decode(&log.encode()).as_ref(), Ok(&log), "the decoded log differs");
                true
            }
            Err(error) => {
                let length = error.to_string().len();
                assert!(length < 8192, "the error has {length} bytes");
                false
            }
        };
        let reads = |scenario| read(scenario, Precision::F64) | read(scenario, Precision::F32);
        scenarios().iter().map(reads).filter(|accepted| *accepted).count() > 0
    })
}

/// Observations that policies read from another process.
fn observation(bytes: &[u8]) -> bool {
    with_json(bytes, |value| {
        first_tasks().map(|task| task.read_observation(&value).is_ok()).filter(|accepted| *accepted).count()
            > 0
    })
}

fn scenario_seeds() -> Vec<Vec<u8>> {
    let mut seeds: Vec<Value> = scenarios().iter().map(Scenario::to_json).collect();
    seeds.push(json!({"task": "kessler/survival", "params": {"debris": 3}, "physics": {"contact": "swept"}, "seed": 1,
        "layout": {"mode": "extend", "provenance": {"by": "x"},
            "bodies": {"debris": [[7000.0, 0.0, 0.0, 7.5]], "rogues": []}}}));
    seeds.push(json!({"task": "docking/single", "params": {}, "seed": 2, "physics": null}));
    let valid = seeds.into_iter().filter(|seed| Scenario::from_json(seed).is_ok());
    json_seeds(valid)
}

fn log_seeds() -> Vec<Vec<u8>> {
    let log = |precision| {
        let mut log = ActionLog::new(2, precision);
        log.push_entry(0, &[0.25, -0.5]);
        log.push_entry(1, &[0.1, 1.0]);
        log.end_step();
        log.end_step();
        log.push_entry(3, &[1e-3, 0.0]);
        log.end_step();
        log.encode()
    };
    vec![log(Precision::F32), log(Precision::F64), ActionLog::new(3, Precision::F64).encode()]
}

fn step_seeds() -> Vec<Vec<u8>> {
    json_seeds([
        json!([[], [[0, 0.1, -0.2]], [[1, 0, 1], [2, 0.5, 0.25]]]),
        json!([[[0, 0.1, -0.2, 0.3]], []]),
        json!([]),
    ])
}

fn observation_seeds() -> Vec<Vec<u8>> {
    let observation = |scenario: &Scenario| {
        let task = scenario.task();
        let episode = task.start(scenario).expect("the scenario is fair");
        serde_json::from_str(&episode.telemetry().to_string()).expect("telemetry is JSON")
    };
    json_seeds(scenarios().iter().map(observation))
}
