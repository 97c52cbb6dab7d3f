//! The OpenEnv protocol: JSON as Python writes it, lax numbers, and actions of all worlds.

use env_core::log::{ActionLog, MAX_ENTRIES, Precision};
use env_core::{JointAction, TaskSpec};
use openenv_wire::{MAX_ERRORS, parse_integer, parse_number, parse_python_json, wire_format};
use serde_json::{Value, json};

use crate::target::{Target, json_seeds, seeds_of, with_json, with_text};

pub(super) const TARGETS: &[Target] = &[
    Target::new("python_json", python_json, python_seeds),
    Target::new("lax_numbers", lax_numbers, number_seeds),
    Target::new("actions", actions, action_seeds),
];

/// Text that is JSON has the value that `serde_json` parses. Every value is the same after it is written and parsed again.
fn python_json(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let lax = serde_json::from_str::<Value>(text);
        let Ok(value) = parse_python_json(text) else {
            assert!(lax.is_err(), "serde_json parses the text");
            return false;
        };
        if let Ok(lax) = lax {
            assert_eq!(value, lax, "serde_json parses another value");
        }
        let written = value.to_string();
        assert_eq!(parse_python_json(&written).ok(), Some(value), "the written value differs");
        true
    })
}

/// A number is finite, and an integer that a text has is the same after it is written and parsed again. Input that is not JSON
/// is a string.
fn lax_numbers(bytes: &[u8]) -> bool {
    let value: Value = serde_json::from_slice(bytes)
        .unwrap_or_else(|_| Value::String(String::from_utf8_lossy(bytes).into_owned()));
    let integer = parse_integer(&value);
    if let Ok(integer) = integer {
        assert_eq!(parse_integer(&Value::String(integer.to_string())), Ok(integer));
        assert_eq!(parse_integer(&Value::from(integer)), Ok(integer));
    }
    let number = parse_number(&value);
    if let Ok(number) = number {
        assert!(number.is_finite(), "{number} is not finite");
        assert_eq!(parse_number(&Value::String(format!("{number:?}"))), Ok(number));
    }
    integer.is_ok() || number.is_ok()
}

/// A rejected action leaves the log unchanged and has a bounded number of errors. An accepted one is one step of finite values,
/// and the step that is written as JSON is valid.
fn actions(bytes: &[u8]) -> bool {
    with_json(bytes, |action| {
        let read = |task: &'static dyn TaskSpec| {
            let double = reads_action(task, &action, Precision::F64);
            let single = reads_action(task, &action, Precision::F32);
            double || single
        };
        tasks_of_all_formats().map(read).filter(|accepted| *accepted).count() > 0
    })
}

/// Returns two tasks of each world, the first and the last: every format is that of one of them.
fn tasks_of_all_formats() -> impl Iterator<Item = &'static dyn TaskSpec> {
    env_core::worlds().flat_map(|world| {
        let tasks = world.tasks();
        [tasks.first(), tasks.last()].map(Option::<&_>::copied).into_iter().flatten()
    })
}

fn reads_action(task: &'static dyn TaskSpec, action: &Value, precision: Precision) -> bool {
    let format = wire_format(task);
    let dim = task.action_space().dim();
    let mut log = ActionLog::new(dim, precision);
    log.push_step(JointAction::HOLD);
    let before = log.clone();
    if let Err(errors) = format.read_action(action, &mut log) {
        assert!((1..=MAX_ERRORS).contains(&errors.len()), "{} errors", errors.len());
        assert_eq!(log, before, "a rejected action changes the log");
        return false;
    }
    assert_eq!(log.len(), 2, "an action is one step");
    let step = log.step(1);
    assert!(step.agents.len() <= MAX_ENTRIES, "{} entries", step.agents.len());
    assert!(step.values.iter().all(|value| value.is_finite()), "{:?}", step.values);
    let written: Value = serde_json::from_str(&format.write_action(step)).expect("a written action is JSON");
    let mut again = ActionLog::new(dim, precision);
    format.read_action(&written, &mut again).expect("a written action is valid");
    // Values are clamped when they are written; agents stay.
    assert_eq!(again.step(0).agents, step.agents, "the written action has other agents");
    true
}

fn python_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        r#"{"burns": [{"satellite_id": 0, "delta_vx": NaN, "delta_vy": -Infinity}]}"#,
        r#"{"seed": 1e999, "a": [1, -2.5e3, true, null, "NaN \" Infinity"]}"#,
        r#"[Infinity, 123456789012345678901234567890, "é\ud83d\ude00"]"#,
    ])
}

fn number_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "12",
        "-0.5",
        "1_000",
        "\"1_000.00\"",
        "true",
        "1e300",
        "9223372036854775808",
        " 7 ",
        "+4",
        "\"\\u00a07\"",
        "3.0",
    ])
}

fn action_seeds() -> Vec<Vec<u8>> {
    let burns = json!([{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": -0.2}, {"satellite_id": 3, "delta_vx": "1e-3", "delta_vy": 0}]);
    let mut seeds = vec![
        json!({"burns": burns}),
        json!({"burns": burns.to_string(), "metadata": {"source": "web"}}),
        json!({"burns": json!({"action": {"burns": burns}}).to_string()}),
        json!({}),
    ];
    for task in tasks_of_all_formats() {
        let mut log = ActionLog::new(task.action_space().dim(), Precision::F64);
        log.push_entry(0, &[1.0, -0.5, 0.125]);
        log.push_entry(1, &[0.0, 1.0, 0.5]);
        log.end_step();
        seeds.extend(serde_json::from_str::<Value>(&wire_format(task).write_action(log.step(0))));
    }
    json_seeds(seeds)
}
