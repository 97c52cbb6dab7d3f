//! Written observations equal the telemetry and conform to the schema.

use std::collections::BTreeSet;

use env_core::log::Precision;
use env_core::task::StepReport;
use env_core::{ActionLog, Episode, Recipe, Scenario, Seed};
use proptest::prelude::*;
use serde_json::{Value, json};

use super::at_level;
use crate::wire_format;

/// Telemetry in the form of the protocol, where `reward` and `done` are outside the observation.
fn expected_observation(episode: &dyn Episode) -> Value {
    let mut telemetry = episode.telemetry();
    let fields = telemetry.as_object_mut().unwrap();
    assert_eq!(fields.remove("reward"), Some(json!(episode.last_reward())));
    assert_eq!(fields.remove("done"), Some(json!(episode.done())));
    telemetry
}

/// Asserts that a value conforms to a schema: types, required fields, and no field without a schema.
fn assert_conforms(value: &Value, schema: &Value, root: &Value) {
    let recurse = |schema| assert_conforms(value, schema, root);
    if let Some(name) = schema["$ref"].as_str() {
        return recurse(&root["$defs"][name.rsplit('/').next().unwrap()]);
    }
    if let Some(choices) = schema["anyOf"].as_array() {
        return recurse(choices.iter().find(|c| (c["type"] == "null") == value.is_null()).unwrap());
    }
    match schema["type"].as_str().unwrap() {
        "object" => {
            let (fields, known) = (value.as_object().unwrap(), schema["properties"].as_object().unwrap());
            for name in schema["required"].as_array().into_iter().flatten() {
                assert!(fields.contains_key(name.as_str().unwrap()), "{name} is missing in {value}");
            }
            for (name, value) in fields {
                let schema = known.get(name).unwrap_or_else(|| panic!("{name} is not in the schema"));
                assert_conforms(value, schema, root);
            }
        }
        "array" => {
            let items = value.as_array().unwrap();
            items.iter().for_each(|item| assert_conforms(item, &schema["items"], root));
            assert!(schema["minItems"].as_u64().is_none_or(|min| items.len() as u64 >= min));
            assert!(schema["maxItems"].as_u64().is_none_or(|max| items.len() as u64 <= max));
        }
        "boolean" => assert!(value.is_boolean(), "{value}"),
        "number" => assert!(value.is_number(), "{value}"),
        "integer" => assert!(value.is_u64(), "{value}"),
        "string" => assert!(value.is_string(), "{value}"),
        "null" => assert!(value.is_null(), "{value}"),
        other => panic!("no observation has a {other}: {value}"),
    }
}

/// Rolls out up to `max_steps` steps and checks the observation of each of the first 20 steps, of every ninth, and of the
/// last. Adds the names of all observed fields to `fields`.
fn check_rollout(scenario: &Scenario, policy: &str, max_steps: u32, fields: &mut BTreeSet<String>) {
    let task = scenario.task();
    let Ok(mut episode) = task.start(scenario) else { return };
    let schema = wire_format(task).observation_schema();
    let mut policy = task.policy(policy, scenario, 1).unwrap();
    let mut log = ActionLog::new(task.action_space().dim(), Precision::F64);
    let mut report = StepReport::default();
    let mut out = b"before".to_vec();
    assert_eq!(episode.last_reward(), 0.0);
    loop {
        if episode.steps() < 20 || episode.steps() % 9 == 0 || episode.done() {
            out.truncate(6);
            episode.write_observation(&mut out);
            assert!(out.starts_with(b"before{"));
            let written: Value = serde_json::from_slice(&out[6..]).unwrap();
            assert_eq!(written, expected_observation(&*episode), "{} step {}", task.id(), episode.steps());
            assert_conforms(&written, schema, schema);
            fields.extend(written.as_object().unwrap().keys().cloned());
            if written["satellites"][0].get("survival_probability").is_some() {
                fields.insert("survival_probability".to_owned());
            }
        }
        if episode.done() || episode.steps() >= max_steps {
            return;
        }
        policy.act(episode.observation(), &mut log).unwrap();
        episode.step(log.step(episode.steps() as usize), &mut report).unwrap();
        assert_eq!(episode.last_reward(), report.reward);
    }
}

/// Every task at several levels to the end, and every choice of every option.
#[test]
fn observations_equal_telemetry_and_conform() {
    let mut fields = BTreeSet::new();
    for task in env_core::tasks() {
        for level in [0, 4, 9] {
            for policy in ["random", "heuristic"] {
                check_rollout(&at_level(task.id(), level, level as u64), policy, u32::MAX, &mut fields);
            }
        }
        for option in task.options() {
            for choice in option.choices {
                let recipe = Recipe::at_level(task, 5).unwrap();
                if let Ok(recipe) = recipe.with_option(option.name, choice) {
                    let scenario = Scenario::new(recipe, Seed::user(5).unwrap());
                    check_rollout(&scenario, "random", u32::MAX, &mut fields);
                }
            }
        }
    }
    for rare in ["conjunctions", "target_separation", "survival_probability", "deputies"] {
        assert!(fields.contains(rare), "{rare} was never observed");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn observations_conform_under_any_options(
        task in 0..env_core::tasks().count(),
        level in 0..10usize,
        choices in prop::collection::vec(any::<prop::sample::Index>(), 12),
        seed in 0..1u64 << 40,
    ) {
        let task = env_core::tasks().nth(task).unwrap();
        let options = task.options().iter().zip(&choices);
        let chosen = options.map(|(option, at)| (option.name, option.choices[at.index(option.choices.len())]));
        // Contradicting options are not a valid recipe.
        if let Ok(recipe) = Recipe::at_level(task, level).unwrap().with_options(chosen) {
            let scenario = Scenario::new(recipe, Seed::user(seed).unwrap());
            check_rollout(&scenario, "random", 60, &mut BTreeSet::new());
        }
    }
}
