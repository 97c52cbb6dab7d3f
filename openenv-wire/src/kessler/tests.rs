//! Compares with recorded exchanges of the public kessler-env on openenv-core.

use env_core::log::{ActionLog, Precision};
use env_core::task::StepReport;
use env_core::{JointAction, kessler};
use serde_json::{Value, json};

use crate::tests::{at_level, decompress};
use crate::{parse_python_json, wire_format};

/// Exchange in which `action` is the extra field, so that it stays in locations.
const WRAPPED: &str = "ws_err_step_http_style_wrapped";

fn recorded_exchanges() -> Value {
    decompress(include_bytes!("../../fixtures/openenv-actions.json.gz"))
}

/// The action in an exchange's request.
fn request_action(exchange: &Value) -> Value {
    let request = &exchange["request"];
    let text = request["text"].as_str().or(request["body_text"].as_str()).unwrap();
    let message = parse_python_json(text).unwrap();
    message.get("data").or(message.get("action")).unwrap().clone()
}

/// The errors in an exchange's response in our form: without `url`, and located relative to the action.
fn response_errors(exchange: &Value) -> Option<Value> {
    let response = &exchange["response"];
    let errors = &response["json"]["data"]["errors"];
    let mut errors = if errors.is_array() { errors } else { &response["body_json"]["detail"] }.clone();
    for error in errors.as_array_mut()? {
        error.as_object_mut().unwrap().remove("url");
        let loc = error["loc"].as_array_mut().unwrap();
        loc.retain(|segment| {
            !["body", "data", "action"].map(Value::from).contains(segment) || exchange["name"] == WRAPPED
        });
    }
    Some(errors)
}

fn read_action(action: &Value) -> Result<ActionLog, Value> {
    let task = env_core::task("kessler/survival").unwrap();
    let mut log = ActionLog::new(2, Precision::F64);
    wire_format(task)
        .read_action(action, &mut log)
        .map_err(|errors| serde_json::to_value(errors).unwrap())?;
    assert_eq!(log.len(), 1);
    Ok(log)
}

/// The burns in the exchanges that openenv-core accepts.
fn expected_burns(name: &str) -> JointAction<'static> {
    let (agents, values): (&[u32], &[f64]) = match name {
        "http_step_one_burn" | "ws_step_one_burn" => (&[0], &[0.3, -0.1]),
        "web_step" | "web_step_burns_string" => (&[0], &[0.2, 0.0]),
        "ws_step_burn_clamped" => (&[0], &[99.0, -99.0]),
        "ws_step_burn_extra_key" => (&[1], &[0.0, 0.0]),
        "ws_step_burn_many_same_sat" => (&[0; 8], [[1.0, 0.0]; 8].as_flattened()),
        "ws_step_burn_string_numbers" => (&[1], &[0.25, 1.0]),
        "ws_step_burns_as_string" => (&[1], &[0.1, 0.0]),
        "ws_step_task2_burn" => (&[0], &[1.0, 0.0]),
        "http_step_empty_burns"
        | "ws_step_burn_unknown_sat"
        | "ws_step_burns_string_wrapped"
        | "ws_step_empty_data"
        | "ws_step_noburn"
        | "ws_step_task3"
        | "ws_step_with_metadata" => (&[], &[]),
        other => panic!("{other} was accepted"),
    };
    JointAction { agents, values }
}

/// Errors that we report and openenv-core does not, as pairs of kind and dotted location. There NaN and the infinities
/// become full burns or a 500; a string that is not JSON, or a wrong field on the web route, is a 500 or ends the session.
fn deliberate_errors(name: &str) -> Option<&'static [(&'static str, &'static str)]> {
    Some(match name {
        "http_step_nan" => &[("finite_number", "burns.0.delta_vx")],
        "ws_step_burn_nan" | "ws_step_burn_inf" => {
            &[("finite_number", "burns.0.delta_vx"), ("finite_number", "burns.0.delta_vy")]
        }
        "http_step_burns_bad_string_500" | "ws_fatal_step_burns_bad_string" => &[("value_error", "burns")],
        "web_step_bad_action" => &[("extra_forbidden", "foo")],
        _ => return None,
    })
}

/// The dotted form of a JSON location.
fn dotted(loc: &Value) -> String {
    let segments = loc.as_array().unwrap().iter();
    segments
        .map(|segment| segment.as_str().map_or_else(|| segment.to_string(), str::to_owned))
        .collect::<Vec<_>>()
        .join(".")
}

#[test]
fn validate_recorded_actions_are_read_alike() {
    let exchanges = recorded_exchanges();
    let (mut accepted, mut rejected, mut different) = (0, 0, 0);
    for (name, exchange) in
        exchanges.as_object().unwrap().iter().filter(|(name, _)| *name != "http_get_schema")
    {
        let read = read_action(&request_action(exchange));
        if let Some(expected) = deliberate_errors(name) {
            different += 1;
            let errors = read.unwrap_err();
            let errors: Vec<_> = errors
                .as_array()
                .unwrap()
                .iter()
                .map(|error| (error["type"].as_str().unwrap(), dotted(&error["loc"])))
                .collect();
            let expected: Vec<_> = expected.iter().map(|&(kind, loc)| (kind, loc.to_owned())).collect();
            assert_eq!(errors, expected, "{name}");
        } else if let Some(errors) = response_errors(exchange) {
            rejected += 1;
            assert_eq!(read.unwrap_err(), errors, "{name}");
        } else {
            accepted += 1;
            assert_eq!(read.unwrap().step(0), expected_burns(name), "{name}");
        }
    }
    assert_eq!((accepted, rejected, different), (17, 10, 6));
}

/// Our schemas equal those of the public kessler-env word for word, except for additions, none of them required.
#[test]
fn validate_schemas_are_those_of_kessler_env() {
    let recorded = &recorded_exchanges()["http_get_schema"]["response"]["body_json"];
    for task in &kessler::KESSLER_TASKS {
        assert_eq!(*wire_format(task).action_schema(), recorded["action"]);
        let mut ours = wire_format(task).observation_schema().clone();
        for (parent, addition) in [
            ("/properties", "conjunctions"),
            ("/properties", "target_separation"),
            ("/$defs", "ConjunctionTelemetry"),
            ("/$defs/SatelliteTelemetry/properties", "survival_probability"),
        ] {
            let removed = ours.pointer_mut(parent).unwrap().as_object_mut().unwrap().remove(addition);
            assert!(removed.is_some(), "{addition}");
        }
        assert_eq!(ours, recorded["observation"]);
    }
}

/// Field names in the order of their first occurrence in a JSON text.
fn field_names(text: &str) -> Vec<&str> {
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
fn validate_observation_fields_are_in_the_same_order() {
    let exchange = &recorded_exchanges()["ws_step_one_burn"];
    let text = exchange["response"]["text"].as_str().unwrap();
    let (_, recorded) = text.split_once("\"observation\":{").unwrap();
    let (recorded, _) = recorded.rsplit_once("},\"reward\":").unwrap();
    let task = env_core::task("kessler/survival").unwrap();
    let mut episode = task.start(&at_level(task.id(), 0, 1)).unwrap();
    let log = read_action(&request_action(exchange)).unwrap();
    episode.step(log.step(0), &mut StepReport::default()).unwrap();
    let mut out = Vec::new();
    episode.write_observation(&mut out);
    let ours = String::from_utf8(out).unwrap();
    assert_eq!(field_names(&ours), field_names(recorded));
    assert_eq!(field_names(&ours).len(), 14);
    // The fuel left is 100 − 5·√(0.3² + 0.1²), the burn that was sent.
    let fuel = serde_json::from_str::<Value>(&ours).unwrap()["satellites"][0]["fuel"].as_f64().unwrap();
    assert_eq!(json!(fuel), json!(98.418_861_169_915_81));
}
