//! Against the captured exchanges of the public kessler-env on openenv-core.

use serde_json::{Value, json};

use crate::log::{ActionLog, Precision};
use crate::task::{StepReport, TaskSpec};
use crate::testing::at_level;
use crate::wire::read_json;
use crate::wire::tests::unpacked;

fn exchanges() -> Value {
    unpacked(include_bytes!("../../../fixtures/openenv-actions.json.gz"))
}

/// The action that an exchange sent.
fn action(exchange: &Value) -> Value {
    let request = &exchange["request"];
    let text = request["text"].as_str().or(request["body_text"].as_str()).unwrap();
    let message = read_json(text).unwrap();
    message.get("data").or(message.get("action")).unwrap().clone()
}

/// The faults that were answered, as ours are told: without `url`, and located from the action on.
fn answered(exchange: &Value) -> Option<Value> {
    let response = &exchange["response"];
    let errors = &response["json"]["data"]["errors"];
    let mut faults = if errors.is_array() { errors } else { &response["body_json"]["detail"] }.clone();
    for fault in faults.as_array_mut()? {
        fault.as_object_mut().unwrap().remove("url");
        let loc = fault["loc"].as_array_mut().unwrap();
        loc.retain(|place| {
            !["body", "data", "action"].map(Value::from).contains(place) || exchange["name"] == WRAPPED
        });
    }
    Some(faults)
}

/// Here `action` is the field at fault.
const WRAPPED: &str = "ws_err_step_http_style_wrapped";

fn read(action: &Value) -> Result<ActionLog, Value> {
    let task = crate::task("kessler/survival").unwrap();
    let mut log = ActionLog::new(2, Precision::F64);
    task.wire().read_action(action, &mut log).map_err(|faults| serde_json::to_value(faults).unwrap())?;
    assert_eq!(log.len(), 1);
    Ok(log)
}

/// What is done in the exchanges that are taken: satellite, dvx, dvy.
fn expected(name: &str) -> Vec<(u32, f64, f64)> {
    match name {
        "http_step_one_burn" | "ws_step_one_burn" => vec![(0, 0.3, -0.1)],
        "web_step" | "web_step_burns_string" => vec![(0, 0.2, 0.0)],
        "ws_step_burn_clamped" => vec![(0, 99.0, -99.0)],
        "ws_step_burn_extra_key" => vec![(1, 0.0, 0.0)],
        "ws_step_burn_many_same_sat" => vec![(0, 1.0, 0.0); 8],
        "ws_step_burn_string_numbers" => vec![(1, 0.25, 1.0)],
        "ws_step_burns_as_string" => vec![(1, 0.1, 0.0)],
        "ws_step_task2_burn" => vec![(0, 1.0, 0.0)],
        "http_step_empty_burns"
        | "ws_step_burn_unknown_sat"
        | "ws_step_burns_string_wrapped"
        | "ws_step_empty_data"
        | "ws_step_noburn"
        | "ws_step_task3"
        | "ws_step_with_metadata" => vec![],
        other => panic!("{other} was taken"),
    }
}

/// Refused here, and otherwise there: NaN and the infinities became full burns or a 500, and a string that is no JSON, or
/// the wrong field on the web route, ended in a 500 or the session's end.
fn deliberate(name: &str) -> Option<&'static [(&'static str, &'static [&'static str])]> {
    Some(match name {
        "http_step_nan" => &[("finite_number", &["burns", "0", "delta_vx"])],
        "ws_step_burn_nan" | "ws_step_burn_inf" => {
            &[("finite_number", &["burns", "0", "delta_vx"]), ("finite_number", &["burns", "0", "delta_vy"])]
        }
        "http_step_burns_bad_string_500" | "ws_fatal_step_burns_bad_string" => &[("value_error", &["burns"])],
        "web_step_bad_action" => &[("extra_forbidden", &["foo"])],
        _ => return None,
    })
}

#[test]
fn validate_openenv_captured_actions_are_read_alike() {
    let exchanges = exchanges();
    let (mut taken, mut refused, mut different) = (0, 0, 0);
    for (name, exchange) in
        exchanges.as_object().unwrap().iter().filter(|(name, _)| *name != "http_get_schema")
    {
        let read = read(&action(exchange));
        if let Some(faults) = deliberate(name) {
            different += 1;
            let found = read.unwrap_err();
            let found = found.as_array().unwrap().iter().map(|fault| {
                let loc = fault["loc"].as_array().unwrap().iter();
                let loc: Vec<_> =
                    loc.map(|p| p.as_str().map_or_else(|| p.to_string(), str::to_owned)).collect();
                (fault["type"].as_str().unwrap().to_owned(), loc)
            });
            let faults = faults
                .iter()
                .map(|(kind, loc)| ((*kind).to_owned(), loc.iter().map(|&p| p.to_owned()).collect()));
            assert_eq!(found.collect::<Vec<_>>(), faults.collect::<Vec<_>>(), "{name}");
        } else if let Some(faults) = answered(exchange) {
            refused += 1;
            assert_eq!(read.unwrap_err(), faults, "{name}");
        } else {
            taken += 1;
            let log = read.unwrap();
            let (agents, values): (Vec<_>, Vec<_>) =
                expected(name).into_iter().map(|(s, x, y)| (s, [x, y])).unzip();
            assert_eq!(
                (log.step(0).agents, log.step(0).values),
                (&agents[..], values.as_flattened()),
                "{name}"
            );
        }
    }
    assert_eq!((taken, refused, different), (17, 10, 6));
}

/// The public kessler-env's schemas, to the word; ours has more, none of it required.
#[test]
fn validate_openenv_schemas_are_those_of_kessler_env() {
    let captured = &exchanges()["http_get_schema"]["response"]["body_json"];
    for task in crate::kessler::TASKS.iter() {
        assert_eq!(*task.wire().action_schema(), captured["action"]);
        let mut ours = task.wire().observation_schema().clone();
        for (parent, more) in [
            ("/properties", "conjunctions"),
            ("/properties", "target_separation"),
            ("/$defs", "ConjunctionTelemetry"),
            ("/$defs/SatelliteTelemetry/properties", "survival_probability"),
        ] {
            assert!(
                ours.pointer_mut(parent).unwrap().as_object_mut().unwrap().remove(more).is_some(),
                "{more}"
            );
        }
        assert_eq!(ours, captured["observation"]);
    }
}

/// Names in the order in which they first stand in a text, from the observation on.
fn names(text: &str) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    let parts: Vec<&str> = text.split('"').collect();
    for pair in parts.windows(2).filter(|pair| pair[1].starts_with(':')) {
        if !names.contains(&pair[0]) {
            names.push(pair[0]);
        }
    }
    names
}

#[test]
fn validate_openenv_observations_have_the_same_fields_in_the_same_order() {
    let text = exchanges()["ws_step_one_burn"]["response"]["text"].as_str().unwrap().to_owned();
    let (_, captured) = text.split_once("\"observation\":{").unwrap();
    let (captured, _) = captured.rsplit_once("},\"reward\":").unwrap();
    let task = crate::task("kessler/survival").unwrap();
    let mut episode = task.start(&at_level(task.id(), 0, 1)).unwrap();
    let mut log = ActionLog::new(2, Precision::F64);
    task.wire().read_action(&action(&exchanges()["ws_step_one_burn"]), &mut log).unwrap();
    episode.step(log.step(0), &mut StepReport::default()).unwrap();
    let mut out = Vec::new();
    episode.write_observation(&mut out);
    let ours = String::from_utf8(out).unwrap();
    assert_eq!(names(&ours), names(captured));
    assert_eq!(names(&ours).len(), 14);
    // What was burnt is what was sent: 5·√(0.3² + 0.1²).
    let fuel = serde_json::from_str::<Value>(&ours).unwrap()["satellites"][0]["fuel"].as_f64().unwrap();
    assert_eq!(json!(fuel), json!(98.418_861_169_915_81));
}
