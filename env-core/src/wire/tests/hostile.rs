//! Whatever is sent: a step, or a bounded list of faults and nothing changed.

use proptest::prelude::*;
use serde_json::{Value, json};

use crate::error::StepError;
use crate::log::{ActionLog, MAX_ENTRIES, Precision};
use crate::task::{StepReport, TaskSpec};
use crate::testing::{any_json, at_level};
use crate::wire::{MAX_ECHO_BYTES, MAX_FAULTS, MAX_TEXT_BYTES, Place, WireFault, read_json};

/// A task of each world, the field its entries stand in, and what an entry has.
const FORMS: [(&str, &str, &[&str]); 2] = [
    ("kessler/survival", "burns", &["satellite_id", "delta_vx", "delta_vy"]),
    ("docking/multiagent", "thrusts", &["deputy_id", "thrust_x", "thrust_y", "thrust_z"]),
];

fn task(id: &str) -> &'static dyn TaskSpec {
    crate::task(id).unwrap()
}

fn log(task: &dyn TaskSpec, precision: Precision) -> ActionLog {
    let mut log = ActionLog::new(task.action_space().columns.len(), precision);
    log.act(0, &[0.5, 0.5, 0.5]);
    log.end_step();
    log
}

/// What is wrong with an action of the world, found quickly enough and told briefly enough.
fn faults(form: usize, action: &Value) -> Vec<WireFault> {
    let task = task(FORMS[form].0);
    let mut log = log(task, Precision::F64);
    let before = log.clone();
    let faults = task.wire().read_action(action, &mut log).unwrap_err();
    assert_eq!(log, before);
    assert!((1..=MAX_FAULTS).contains(&faults.len()));
    // Echoes, and names of fields in places, are bounded; words are short. Escapes may double what a cut string takes.
    let told = serde_json::to_string(&faults).unwrap().len();
    assert!(told <= faults.len() * (5 * MAX_ECHO_BYTES), "{told}");
    faults
}

fn kinds(faults: &[WireFault]) -> Vec<&'static str> {
    faults.iter().map(|fault| fault.kind).collect()
}

#[test]
fn no_more_entries_than_a_step_takes() {
    let burn = json!({"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0});
    let task = task("kessler/survival");
    let mut taken = log(task, Precision::F64);
    task.wire().read_action(&json!({"burns": vec![&burn; MAX_ENTRIES]}), &mut taken).unwrap();
    assert_eq!(taken.step(1).agents.len(), MAX_ENTRIES);
    for count in [MAX_ENTRIES + 1, 100_000] {
        let found = faults(0, &json!({"burns": vec![&burn; count]}));
        assert_eq!(kinds(&found), ["too_long"]);
        assert_eq!(found[0].ctx.as_ref().unwrap()["actual_length"], count);
        assert_eq!(found[0].msg, format!("List should have at most 64 items after validation, not {count}"));
        let echo = found[0].input.as_str().unwrap();
        assert!(
            echo.starts_with("[{\"delta_vx\":0.1,") && echo.ends_with('…') && echo.len() <= MAX_ECHO_BYTES
        );
    }
}

#[test]
fn no_more_faults_than_can_be_read() {
    let wrong = faults(0, &json!({"burns": vec![json!({}); MAX_ENTRIES], "also": 1}));
    assert_eq!(kinds(&wrong), ["missing"; MAX_FAULTS]);
    let many: Value = (0..100_000).map(|i| (i.to_string(), json!(i))).collect();
    assert_eq!(kinds(&faults(1, &many)), ["extra_forbidden"; MAX_FAULTS]);
    let name = "é".repeat(100_000);
    let named = faults(0, &json!({name: "é".repeat(100_000)}));
    let Place::Field(told) = &named[0].loc[0] else { panic!() };
    assert!(told.len() <= MAX_ECHO_BYTES && told.ends_with("é…"));
    let echo = named[0].input.as_str().unwrap();
    assert!(echo.len() <= MAX_ECHO_BYTES && echo.starts_with("\"éé") && echo.ends_with('…'), "{echo}");
}

#[test]
fn short_inputs_are_echoed_as_they_were() {
    let nested = json!({"a": [1, 2.5, {"b": null}], "c": "é\n"});
    assert_eq!(faults(0, &json!({"foo": &nested}))[0].input, nested);
    let text = "x".repeat(MAX_ECHO_BYTES - 2);
    assert_eq!(faults(0, &json!({"foo": &text}))[0].input, json!(text));
    assert_ne!(faults(0, &json!({"foo": format!("{text}x")}))[0].input, json!(format!("{text}x")));
}

#[test]
fn a_list_in_a_string_is_bounded_too() {
    let with = |text: String| faults(0, &json!({"burns": text}));
    assert_eq!(kinds(&with(" ".repeat(MAX_TEXT_BYTES + 1))), ["string_too_long"]);
    assert_eq!(kinds(&with("[".repeat(MAX_TEXT_BYTES))), ["value_error"]);
    assert_eq!(kinds(&with("{\"burns\":".repeat(5000))), ["value_error"]);
    assert_eq!(kinds(&with(format!("{}{}", "[".repeat(100), "]".repeat(100)))), ["model_type"]);
    // A string in the string is no list, however often.
    let mut text = "[]".to_owned();
    for _ in 0..10 {
        text = json!(text).to_string();
        let found = with(text.clone());
        assert_eq!(kinds(&found), ["list_type"]);
        assert!(found[0].input.is_string());
    }
    assert_eq!(kinds(&with(json!({"burns": "[]"}).to_string())), ["list_type"]);
    assert_eq!(kinds(&with(json!({"action": {"burns": {"action": []}}}).to_string())), ["list_type"]);
    assert_eq!(kinds(&with("null".to_owned())), ["list_type"]);
    let strange = with("[{\"satellite_id\":NaN,\"delta_vx\":NaN,\"delta_vy\":-1e400}]".to_owned());
    assert_eq!(kinds(&strange), ["finite_number"; 3]);
}

#[test]
fn what_is_no_object_is_no_action() {
    for action in [json!(null), json!([]), json!("x"), json!(5), json!(true)] {
        let found = faults(0, &action);
        assert_eq!((kinds(&found), found[0].loc.len()), (vec!["dict_type"], 0));
        assert_eq!(found[0].input, action);
    }
}

#[test]
fn faults_come_in_pydantics_order() {
    let found = faults(0, &json!({"aaa": 1, "burns": [1], "metadata": [], "zzz": {}}));
    assert_eq!(
        serde_json::to_value(&found).unwrap(),
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
fn agents_that_only_this_episode_lacks_can_be_dropped() {
    let task = task("docking/multiagent");
    let mut log = log(task, Precision::F64);
    let thrust = |id: i64, x: f64| json!({"deputy_id": id, "thrust_x": x, "thrust_y": 0, "thrust_z": "0.5"});
    let thrusts = json!([
        thrust(4, 0.1),
        thrust(1, 0.2),
        thrust(5, 0.3),
        thrust(-1, 0.4),
        thrust(3, 0.5),
        thrust(0, 0.6)
    ]);
    task.wire().read_action(&json!({"thrusts": thrusts}), &mut log).unwrap();
    assert_eq!(log.step(1).agents, [4, 1, 3, 0]);
    let scenario = at_level("docking/multiagent", 3, 1);
    let mut episode = task.start(&scenario).unwrap();
    let mut report = StepReport::default();
    let refused = episode.step(log.step(1), &mut report).unwrap_err();
    assert_eq!(refused, StepError::UnknownAgent { agent: 4, last: 2 });
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

/// Numbers in all their forms, and what is none.
fn cell() -> impl Strategy<Value = Value> {
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

/// Nearly an action of the world, its list plain, in a string or wrapped.
fn nearly(form: usize) -> impl Strategy<Value = Value> {
    let (_, list, names) = FORMS[form];
    let entry = prop::collection::vec(cell(), names.len()).prop_map(move |cells| {
        names.iter().zip(cells).map(|(name, cell)| ((*name).to_owned(), cell)).collect::<Value>()
    });
    let whole = (prop::collection::vec(entry, 0..4), 0..8usize, any_json(cell(), &KEYS));
    whole.prop_map(move |(entries, how, other)| match how {
        0 => json!({list: json!(entries).to_string()}),
        1 => json!({list: json!({"action": {list: entries}}).to_string()}),
        2 => json!({list: entries, "metadata": other}),
        3 => json!({list: other}),
        4 => other,
        _ => json!({list: entries}),
    })
}

/// Read or refused, and what was read can be flown.
fn taken_or_refused(form: usize, action: &Value, precision: Precision) -> Result<(), TestCaseError> {
    let task = task(FORMS[form].0);
    let mut read = log(task, precision);
    let before = read.clone();
    match task.wire().read_action(action, &mut read) {
        Ok(()) => {
            prop_assert_eq!(read.len(), before.len() + 1);
            prop_assert_eq!(read.step(0), before.step(0));
            let scenario = at_level(task.id(), 0, 1);
            read.keep_agents(task.agents(scenario.recipe()));
            let mut episode = task.start(&scenario).unwrap();
            episode.step(read.step(1), &mut StepReport::default()).unwrap();
        }
        Err(found) => {
            prop_assert_eq!(read, before);
            prop_assert!((1..=MAX_FAULTS).contains(&found.len()));
            prop_assert!(found.iter().all(|fault| !fault.msg.is_empty() && fault.loc.len() <= 3));
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn any_action_is_one_step_or_none(
        (form, action) in (0..2usize).prop_flat_map(|form| (Just(form), nearly(form))),
        single: bool,
    ) {
        taken_or_refused(form, &action, if single { Precision::F32 } else { Precision::F64 })?;
    }

    #[test]
    fn any_bytes_are_one_step_or_none(
        bytes in prop::collection::vec(any::<u8>(), 0..40),
        text in "(\\{|\\}|\\[|\\]|:|,|\"|\\\\|NaN|1e400|\"(burns|satellite_id|delta_vx|delta_vy)\":|0|1|-| ){0,30}",
        form in 0..2usize,
    ) {
        let action = json!({FORMS[form].1: String::from_utf8_lossy(&bytes)});
        taken_or_refused(form, &action, Precision::F64)?;
        taken_or_refused(form, &json!({FORMS[form].1: text}), Precision::F64)?;
        if let Ok(action) = read_json(&text) {
            taken_or_refused(form, &action, Precision::F64)?;
        }
    }
}

proptest! {
    /// What is written is read as it was, and within the schema that writers are held to.
    #[test]
    fn what_is_written_is_read(
        form in 0..FORMS.len(),
        entries in prop::collection::vec((0u32..3, prop::array::uniform3(-2.0f64..2.0)), 0..5),
    ) {
        let (id, list, fields) = FORMS[form];
        let (wire, dim) = (task(id).wire(), fields.len() - 1);
        let mut meant = ActionLog::new(dim, Precision::F64);
        entries.iter().for_each(|(agent, values)| meant.act(*agent, &values[..dim]));
        meant.end_step();
        let text = wire.write_action(meant.step(0));
        let mut read = ActionLog::new(dim, Precision::F64);
        wire.read_action(&read_json(&text).unwrap(), &mut read).unwrap();
        let clamped: Vec<f64> = meant.step(0).values.iter().map(|value| value.clamp(-1.0, 1.0)).collect();
        prop_assert_eq!(read.step(0), crate::JointAction { agents: meant.step(0).agents, values: &clamped });
        // Its fields stand in the order of the action space.
        let first = text.find(fields[0]).zip(text.find(fields[1]));
        prop_assert!(first.is_none_or(|(agent, value)| agent < value));
        let schema = wire.strict_schema();
        let item = &schema["properties"][list]["items"];
        prop_assert_eq!(item["required"].as_array().unwrap().len(), fields.len());
        for name in &fields[1..] {
            prop_assert_eq!(item["properties"][*name]["maximum"].as_f64(), Some(1.0));
            prop_assert!(item["properties"][*name]["description"].is_string());
        }
    }
}
