//! Any input is either one step, or a bounded list of errors that leaves the log unchanged.

use env_core::log::{ActionLog, MAX_ENTRIES, Precision};
use env_core::task::StepReport;
use env_core::{JointAction, StepError, TaskSpec};
use proptest::prelude::*;
use serde_json::{Value, json};

use super::{any_json, at_level};
use crate::{
    LocSegment, MAX_ECHO_BYTES, MAX_ERRORS, MAX_TEXT_BYTES, ValidationError, parse_python_json, wire_format,
};

/// A task of a world, and the names of its action's fields.
struct ActionFields {
    task: &'static str,
    list: &'static str,
    entry: &'static [&'static str],
}

const KESSLER: ActionFields = ActionFields {
    task: "kessler/survival",
    list: "burns",
    entry: &["satellite_id", "delta_vx", "delta_vy"],
};
const DOCKING: ActionFields = ActionFields {
    task: "docking/multiagent",
    list: "thrusts",
    entry: &["deputy_id", "thrust_x", "thrust_y", "thrust_z"],
};
const WORLDS: [ActionFields; 2] = [KESSLER, DOCKING];

fn task(id: &str) -> &'static dyn TaskSpec {
    env_core::task(id).unwrap()
}

/// A log with one step.
fn log_of_one_step(task: &dyn TaskSpec, precision: Precision) -> ActionLog {
    let mut log = ActionLog::new(task.action_space().dim(), precision);
    log.push_entry(0, &[0.5, 0.5, 0.5]);
    log.end_step();
    log
}

/// The errors of an invalid action, checked to be few and short.
fn errors_of(world: &ActionFields, action: &Value) -> Vec<ValidationError> {
    let task = task(world.task);
    let mut log = log_of_one_step(task, Precision::F64);
    let before = log.clone();
    let errors = wire_format(task).read_action(action, &mut log).unwrap_err();
    assert_eq!(log, before);
    assert!((1..=MAX_ERRORS).contains(&errors.len()));
    // Echoes and field names are bounded, messages are short; escapes may double the length of a truncated string.
    let bytes = serde_json::to_string(&errors).unwrap().len();
    assert!(bytes <= errors.len() * (5 * MAX_ECHO_BYTES), "{bytes}");
    errors
}

fn kinds(errors: &[ValidationError]) -> Vec<&'static str> {
    errors.iter().map(|error| error.kind).collect()
}

#[test]
fn too_many_entries_are_rejected() {
    let burn = json!({"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0});
    let task = task("kessler/survival");
    let mut log = log_of_one_step(task, Precision::F64);
    wire_format(task).read_action(&json!({"burns": vec![&burn; MAX_ENTRIES]}), &mut log).unwrap();
    assert_eq!(log.step(1).agents.len(), MAX_ENTRIES);
    for count in [MAX_ENTRIES + 1, 100_000] {
        let errors = errors_of(&KESSLER, &json!({"burns": vec![&burn; count]}));
        assert_eq!(kinds(&errors), ["too_long"]);
        assert_eq!(errors[0].ctx.as_ref().unwrap()["actual_length"], count);
        assert_eq!(errors[0].msg, format!("List should have at most 64 items after validation, not {count}"));
        let echo = errors[0].input.as_str().unwrap();
        assert!(
            echo.starts_with("[{\"delta_vx\":0.1,") && echo.ends_with('…') && echo.len() <= MAX_ECHO_BYTES
        );
    }
}

#[test]
fn number_and_size_of_errors_are_bounded() {
    let errors = errors_of(&KESSLER, &json!({"burns": vec![json!({}); MAX_ENTRIES], "also": 1}));
    assert_eq!(kinds(&errors), ["missing"; MAX_ERRORS]);
    let extra: Value = (0..100_000).map(|i| (i.to_string(), json!(i))).collect();
    assert_eq!(kinds(&errors_of(&DOCKING, &extra)), ["extra_forbidden"; MAX_ERRORS]);
    let long_name = "é".repeat(100_000);
    let errors = errors_of(&KESSLER, &json!({long_name: "é".repeat(100_000)}));
    let LocSegment::Field(name) = &errors[0].loc[0] else { panic!() };
    assert!(name.len() <= MAX_ECHO_BYTES && name.ends_with("é…"));
    let echo = errors[0].input.as_str().unwrap();
    assert!(echo.len() <= MAX_ECHO_BYTES && echo.starts_with("\"éé") && echo.ends_with('…'), "{echo}");
}

#[test]
fn short_inputs_are_echoed_unchanged() {
    let nested = json!({"a": [1, 2.5, {"b": null}], "c": "é\n"});
    assert_eq!(errors_of(&KESSLER, &json!({"foo": &nested}))[0].input, nested);
    let text = "x".repeat(MAX_ECHO_BYTES - 2);
    assert_eq!(errors_of(&KESSLER, &json!({"foo": &text}))[0].input, json!(text));
    let longer = json!(format!("{text}x"));
    assert_ne!(errors_of(&KESSLER, &json!({"foo": &longer}))[0].input, longer);
}

#[test]
fn lists_in_strings_are_bounded() {
    let errors_of_text = |text: String| errors_of(&KESSLER, &json!({"burns": text}));
    assert_eq!(kinds(&errors_of_text(" ".repeat(MAX_TEXT_BYTES + 1))), ["string_too_long"]);
    assert_eq!(kinds(&errors_of_text("[".repeat(MAX_TEXT_BYTES))), ["value_error"]);
    assert_eq!(kinds(&errors_of_text("{\"burns\":".repeat(5000))), ["value_error"]);
    assert_eq!(kinds(&errors_of_text(format!("{}{}", "[".repeat(100), "]".repeat(100)))), ["model_type"]);
    // A string within the string is not a list, at any depth.
    let mut text = "[]".to_owned();
    for _ in 0..10 {
        text = json!(text).to_string();
        let errors = errors_of_text(text.clone());
        assert_eq!(kinds(&errors), ["list_type"]);
        assert!(errors[0].input.is_string());
    }
    assert_eq!(kinds(&errors_of_text(json!({"burns": "[]"}).to_string())), ["list_type"]);
    assert_eq!(
        kinds(&errors_of_text(json!({"action": {"burns": {"action": []}}}).to_string())),
        ["list_type"]
    );
    assert_eq!(kinds(&errors_of_text("null".to_owned())), ["list_type"]);
    let not_finite = "[{\"satellite_id\":NaN,\"delta_vx\":NaN,\"delta_vy\":-1e400}]".to_owned();
    assert_eq!(kinds(&errors_of_text(not_finite)), ["finite_number"; 3]);
}

#[test]
fn non_object_is_rejected() {
    for action in [json!(null), json!([]), json!("x"), json!(5), json!(true)] {
        let errors = errors_of(&KESSLER, &action);
        assert_eq!((kinds(&errors), errors[0].loc.len()), (vec!["dict_type"], 0));
        assert_eq!(errors[0].input, action);
    }
}

#[test]
fn errors_are_in_pydantics_order() {
    let errors = errors_of(&KESSLER, &json!({"aaa": 1, "burns": [1], "metadata": [], "zzz": {}}));
    assert_eq!(
        serde_json::to_value(&errors).unwrap(),
        json!([
            {"type": "dict_type", "loc": ["metadata"], "msg": "Input should be a valid dictionary", "input": []},
            {
                "type": "model_type", "loc": ["burns", 0],
                "msg": "Input should be a valid dictionary or instance of ThrusterBurn",
                "input": 1, "ctx": {"class_name": "ThrusterBurn"},
            },
            {"type": "extra_forbidden", "loc": ["aaa"], "msg": "Extra inputs are not permitted", "input": 1},
            {"type": "extra_forbidden", "loc": ["zzz"], "msg": "Extra inputs are not permitted", "input": {}},
        ])
    );
}

#[test]
fn entries_of_absent_agents_can_be_dropped() {
    let task = task("docking/multiagent");
    let mut log = log_of_one_step(task, Precision::F64);
    let thrust = |id: i64, x: f64| json!({"deputy_id": id, "thrust_x": x, "thrust_y": 0, "thrust_z": "0.5"});
    let thrusts = json!([
        thrust(4, 0.1),
        thrust(1, 0.2),
        thrust(5, 0.3),
        thrust(-1, 0.4),
        thrust(3, 0.5),
        thrust(0, 0.6)
    ]);
    wire_format(task).read_action(&json!({"thrusts": thrusts}), &mut log).unwrap();
    assert_eq!(log.step(1).agents, [4, 1, 3, 0]);
    let scenario = at_level("docking/multiagent", 3, 1);
    let mut episode = task.start(&scenario).unwrap();
    let mut report = StepReport::default();
    let error = episode.step(log.step(1), &mut report).unwrap_err();
    assert_eq!(error, StepError::UnknownAgent { agent: 4, last: 2 });
    log.keep_agents(task.agents(scenario.recipe()));
    assert_eq!((log.step(1).agents, log.step(1).values), (&[1, 0][..], &[0.2, 0.0, 0.5, 0.6, 0.0, 0.5][..]));
    assert_eq!(log.step(0).agents, [0]);
    episode.step(log.step(1), &mut report).unwrap();
    log.keep_agents(0);
    assert_eq!((log.len(), log.step(1).agents.len(), log.step(0).agents), (2, 0, &[0][..]));
}

const KEYS: [&str; 12] = [
    "burns",
    "thrusts",
    "metadata",
    "action",
    "satellite_id",
    "delta_vx",
    "delta_vy",
    "deputy_id",
    "thrust_x",
    "thrust_y",
    "thrust_z",
    "note",
];

/// Strategy for numbers in all forms, and values that are not numbers.
fn number_like() -> impl Strategy<Value = Value> {
    const WORDS: [&str; 10] =
        ["1", "0.25", " 2 ", "nan", "inf", "1e400", "x", "", "1_0", "9999999999999999999999"];
    prop_oneof![
        6 => (0i64..3).prop_map(Value::from),
        6 => (-1.5..1.5f64).prop_map(Value::from),
        2 => any::<f64>().prop_map(Value::from),
        2 => any::<i64>().prop_map(Value::from),
        1 => any::<bool>().prop_map(Value::from),
        2 => prop::sample::select(&WORDS[..]).prop_map(Value::from),
        1 => prop::sample::select(vec![json!(null), json!([]), json!({})]),
    ]
}

/// Strategy for values close to an action of the world, its list plain, in a string or wrapped.
fn action_like(world: usize) -> impl Strategy<Value = Value> {
    let ActionFields { list, entry, .. } = WORLDS[world];
    let entry = prop::collection::vec(number_like(), entry.len()).prop_map(move |cells| {
        entry.iter().zip(cells).map(|(name, cell)| ((*name).to_owned(), cell)).collect::<Value>()
    });
    let parts = (prop::collection::vec(entry, 0..4), 0..8usize, any_json(number_like(), &KEYS));
    parts.prop_map(move |(entries, form, other)| match form {
        0 => json!({list: json!(entries).to_string()}),
        1 => json!({list: json!({"action": {list: entries}}).to_string()}),
        2 => json!({list: entries, "metadata": other}),
        3 => json!({list: other}),
        4 => other,
        _ => json!({list: entries}),
    })
}

/// Checks that the action is rejected without effect, or that the step it became can be executed.
fn check_action(world: &ActionFields, action: &Value, precision: Precision) -> Result<(), TestCaseError> {
    let task = task(world.task);
    let mut log = log_of_one_step(task, precision);
    let before = log.clone();
    match wire_format(task).read_action(action, &mut log) {
        Ok(()) => {
            prop_assert_eq!(log.len(), before.len() + 1);
            prop_assert_eq!(log.step(0), before.step(0));
            let scenario = at_level(task.id(), 0, 1);
            log.keep_agents(task.agents(scenario.recipe()));
            let mut episode = task.start(&scenario).unwrap();
            episode.step(log.step(1), &mut StepReport::default()).unwrap();
        }
        Err(errors) => {
            prop_assert_eq!(log, before);
            prop_assert!((1..=MAX_ERRORS).contains(&errors.len()));
            prop_assert!(errors.iter().all(|error| !error.msg.is_empty() && error.loc.len() <= 3));
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn any_action_is_one_step_or_rejected(
        (world, action) in (0..WORLDS.len()).prop_flat_map(|world| (Just(world), action_like(world))),
        single: bool,
    ) {
        check_action(&WORLDS[world], &action, if single { Precision::F32 } else { Precision::F64 })?;
    }

    #[test]
    fn any_bytes_are_one_step_or_rejected(
        bytes in prop::collection::vec(any::<u8>(), 0..40),
        text in "(\\{|\\}|\\[|\\]|:|,|\"|\\\\|NaN|1e400|\"(burns|satellite_id|delta_vx|delta_vy)\":|0|1|-| ){0,30}",
        world in 0..WORLDS.len(),
    ) {
        let world = &WORLDS[world];
        let action = json!({world.list: String::from_utf8_lossy(&bytes)});
        check_action(world, &action, Precision::F64)?;
        check_action(world, &json!({world.list: text}), Precision::F64)?;
        if let Ok(action) = parse_python_json(&text) {
            check_action(world, &action, Precision::F64)?;
        }
    }

    /// A written action reads back as its clamped step, and conforms to the strict schema.
    #[test]
    fn written_actions_read_back(
        world in 0..WORLDS.len(),
        entries in prop::collection::vec((0u32..3, prop::array::uniform3(-2.0f64..2.0)), 0..5),
    ) {
        let ActionFields { task: id, list, entry: fields } = WORLDS[world];
        let (format, dim) = (wire_format(task(id)), fields.len() - 1);
        let mut log = ActionLog::new(dim, Precision::F64);
        entries.iter().for_each(|(agent, values)| log.push_entry(*agent, &values[..dim]));
        log.end_step();
        let text = format.write_action(log.step(0));
        let mut read = ActionLog::new(dim, Precision::F64);
        format.read_action(&parse_python_json(&text).unwrap(), &mut read).unwrap();
        let clamped: Vec<f64> = log.step(0).values.iter().map(|value| value.clamp(-1.0, 1.0)).collect();
        prop_assert_eq!(read.step(0), JointAction { agents: log.step(0).agents, values: &clamped });
        // Fields are in the order of the action space.
        let first = text.find(fields[0]).zip(text.find(fields[1]));
        prop_assert!(first.is_none_or(|(agent, value)| agent < value));
        let schema = format.strict_schema();
        let item = &schema["properties"][list]["items"];
        prop_assert_eq!(item["required"].as_array().unwrap().len(), fields.len());
        for name in &fields[1..] {
            prop_assert_eq!(item["properties"][*name]["maximum"].as_f64(), Some(1.0));
            prop_assert!(item["properties"][*name]["description"].is_string());
        }
    }
}
