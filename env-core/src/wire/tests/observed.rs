//! What is written is what telemetry says, and what the schema promises.

use proptest::prelude::*;
use serde_json::{Value, json};

use crate::log::{ActionLog, Precision};
use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;
use crate::task::{Episode, StepReport, TaskSpec};

/// Telemetry as the wire has it: reward and done stand beside the observation.
fn seen(episode: &dyn Episode) -> Value {
    let mut seen = episode.telemetry();
    let fields = seen.as_object_mut().unwrap();
    assert_eq!(fields.remove("reward"), Some(json!(episode.last_reward())));
    assert_eq!(fields.remove("done"), Some(json!(episode.done())));
    seen
}

/// Asserts that a value is what a schema allows: types, what is required, and nothing that is not told.
fn conforms(value: &Value, schema: &Value, whole: &Value) {
    let inner = |schema| conforms(value, schema, whole);
    if let Some(name) = schema["$ref"].as_str() {
        return inner(&whole["$defs"][name.rsplit('/').next().unwrap()]);
    }
    if let Some(choices) = schema["anyOf"].as_array() {
        return inner(choices.iter().find(|c| (c["type"] == "null") == value.is_null()).unwrap());
    }
    match schema["type"].as_str().unwrap() {
        "object" => {
            let (fields, known) = (value.as_object().unwrap(), schema["properties"].as_object().unwrap());
            for name in schema["required"].as_array().into_iter().flatten() {
                assert!(fields.contains_key(name.as_str().unwrap()), "{name} is missing in {value}");
            }
            for (name, value) in fields {
                conforms(
                    value,
                    known.get(name).unwrap_or_else(|| panic!("{name} is not in the schema")),
                    whole,
                );
            }
        }
        "array" => {
            let items = value.as_array().unwrap();
            items.iter().for_each(|item| conforms(item, &schema["items"], whole));
            assert!(schema["minItems"].as_u64().is_none_or(|least| items.len() as u64 >= least));
            assert!(schema["maxItems"].as_u64().is_none_or(|most| items.len() as u64 <= most));
        }
        "number" => assert!(value.is_number(), "{value}"),
        "integer" => assert!(value.is_u64(), "{value}"),
        "string" => assert!(value.is_string(), "{value}"),
        "null" => assert!(value.is_null(), "{value}"),
        other => panic!("no observation has a {other}: {value}"),
    }
}

/// Flies to the end, or for so long, and looks after each of the first steps and now and then; the fields ever seen.
fn fly(scenario: &Scenario, policy: &str, steps: u32, fields: &mut Vec<String>) {
    let task = scenario.recipe().task();
    let Ok(mut episode) = task.start(scenario) else { return };
    let mut policy = task.policy(policy, scenario, 1).unwrap();
    let mut log = ActionLog::new(task.action_space().columns.len(), Precision::F64);
    let mut report = StepReport::default();
    let mut out = b"before".to_vec();
    assert_eq!(episode.last_reward(), 0.0);
    loop {
        if episode.steps() < 20 || episode.steps() % 9 == 0 || episode.done() {
            out.truncate(6);
            episode.write_observation(&mut out);
            assert!(out.starts_with(b"before{"));
            let written: Value = serde_json::from_slice(&out[6..]).unwrap();
            assert_eq!(written, seen(&*episode), "{} step {}", task.id(), episode.steps());
            conforms(&written, task.wire().observation_schema(), task.wire().observation_schema());
            fields.extend(
                written
                    .as_object()
                    .unwrap()
                    .keys()
                    .filter(|key| !fields.contains(key))
                    .cloned()
                    .collect::<Vec<_>>(),
            );
            if written["satellites"][0].get("survival_probability").is_some() {
                fields.push("survival_probability".to_owned());
            }
        }
        if episode.done() || episode.steps() >= steps {
            return;
        }
        policy.act(episode.observation(), &mut log);
        episode.step(log.step(episode.steps() as usize), &mut report).unwrap();
        assert_eq!(episode.last_reward(), report.reward);
    }
}

fn recipe(task: &'static dyn TaskSpec, level: usize) -> Recipe {
    Recipe::with_params(task, task.levels().params(level)).unwrap()
}

/// Every task at several levels to the end, and every choice of every option.
#[test]
fn observations_are_telemetry_and_conform() {
    let mut fields = Vec::new();
    for task in crate::tasks() {
        for level in [0, 4, 9] {
            for policy in ["random", "heuristic"] {
                let scenario = Scenario::new(recipe(task, level), Seed::user(level as u64).unwrap());
                fly(&scenario, policy, u32::MAX, &mut fields);
            }
        }
        for option in task.options() {
            for choice in option.choices {
                if let Ok(recipe) = recipe(task, 5).with_option(option.name, choice) {
                    fly(&Scenario::new(recipe, Seed::user(5).unwrap()), "random", u32::MAX, &mut fields);
                }
            }
        }
    }
    for rare in ["conjunctions", "target_separation", "survival_probability", "deputies"] {
        assert!(fields.iter().any(|field| field == rare), "{rare} was never seen");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Any options together.
    #[test]
    fn observations_are_telemetry_under_any_options(
        task in 0..crate::tasks().count(),
        level in 0..10usize,
        choices in prop::collection::vec(any::<prop::sample::Index>(), 12),
        seed in 0..1u64 << 40,
    ) {
        let task = crate::tasks().nth(task).unwrap();
        let options = task.options().iter().zip(&choices);
        let chosen = options.map(|(option, at)| (option.name, option.choices[at.index(option.choices.len())]));
        // Options that contradict each other are no scenario.
        if let Ok(recipe) = recipe(task, level).with_options(chosen) {
            fly(&Scenario::new(recipe, Seed::user(seed).unwrap()), "random", 60, &mut Vec::new());
        }
    }
}
