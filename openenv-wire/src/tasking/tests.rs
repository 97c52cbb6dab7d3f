//! Reading named actions, and the tools of tasking.

use env_core::log::{ActionLog, Precision};
use env_core::tasking::task::TASKING_TASKS;
use serde_json::{Value, json};

use crate::{ActionTool, wire_format};

const SCANNING: usize = 0;
const CONSTELLATION: usize = 2;

fn read_action(task: usize, action: &Value) -> Result<ActionLog, Value> {
    let mut log = ActionLog::new(1, Precision::F64);
    wire_format(&TASKING_TASKS[task])
        .read_action(action, &mut log)
        .map_err(|errors| serde_json::to_value(errors).unwrap())?;
    Ok(log)
}

fn call(task: usize, name: &str, arguments: Value) -> Result<Value, String> {
    let format = wire_format(&TASKING_TASKS[task]);
    let tool: &ActionTool = format.tools().iter().find(|tool| tool.name == name).unwrap();
    format.tool_action(tool, serde_json::from_value(arguments).unwrap())
}

#[test]
fn actions_are_read_by_name_and_index() {
    let actions = json!([
        {"satellite_id": 2, "action": "image_9", "note": "ignored"},
        {"satellite_id": "0", "action": 11},
        {"satellite_id": 8, "action": "charge"},
    ]);
    for action in [json!({"actions": actions}), json!({"actions": actions.to_string()})] {
        let log = read_action(CONSTELLATION, &action).unwrap();
        assert_eq!(log.step(0).agents, [2, 0]);
        assert_eq!(log.step(0).values, [9.0, 11.0]);
    }
    assert_eq!(read_action(SCANNING, &json!({})).unwrap().step(0).agents.len(), 0);
    let written = wire_format(&TASKING_TASKS[CONSTELLATION])
        .write_action(read_action(CONSTELLATION, &json!({"actions": actions})).unwrap().step(0));
    let text =
        r#"{"actions":[{"satellite_id":2,"action":"image_9"},{"satellite_id":0,"action":"downlink"}]}"#;
    assert_eq!(written, text);
}

#[test]
fn unknown_actions_list_the_known_ones() {
    for value in [json!("image_0"), json!(4), json!(-1), json!(0.5), json!("0"), json!(null), json!(true)] {
        let errors = read_action(SCANNING, &json!({"actions": [{"satellite_id": 0, "action": value}]}));
        let expected = "'scan', 'charge', 'downlink' or 'desaturate'";
        assert_eq!(
            errors.unwrap_err(),
            json!([{
                "type": "literal_error", "loc": ["actions", 0, "action"],
                "msg": format!("Input should be {expected}"), "input": value, "ctx": {"expected": expected},
            }])
        );
    }
}

#[test]
fn tools_become_actions() {
    let names = |task: usize| -> Vec<_> {
        wire_format(&TASKING_TASKS[task]).tools().iter().map(|tool| tool.name).collect()
    };
    assert_eq!(names(SCANNING), ["scan", "charge", "downlink", "desaturate"]);
    assert_eq!(names(CONSTELLATION), ["image", "charge", "downlink", "desaturate", "act"]);
    let scan = json!({"actions": [{"satellite_id": 0, "action": "scan"}]});
    assert_eq!(call(SCANNING, "scan", json!({})).unwrap(), scan);
    let image = json!({"actions": [{"satellite_id": 3, "action": 7}]});
    assert_eq!(call(CONSTELLATION, "image", json!({"index": 7, "satellite_id": 3})).unwrap(), image);
    let both =
        json!({"actions": [{"satellite_id": 0, "action": "charge"}, {"satellite_id": 1, "action": 2}]});
    assert_eq!(call(CONSTELLATION, "act", both.clone()).unwrap(), both);
    for task in [SCANNING, CONSTELLATION] {
        for tool in wire_format(&TASKING_TASKS[task]).tools() {
            let arguments = if tool.name == "image" { json!({"index": 0}) } else { json!({}) };
            read_action(task, &call(task, tool.name, arguments).unwrap()).unwrap();
        }
    }
}

#[test]
fn wrong_arguments_of_tools_are_named() {
    let fault = |name, arguments| call(CONSTELLATION, name, arguments).unwrap_err();
    assert_eq!(fault("image", json!({})), "index: is required");
    assert_eq!(fault("image", json!({"index": 10})), "index: must be an integer from 0 to 9, got 10");
    assert_eq!(fault("image", json!({"index": "2"})), r#"index: must be an integer from 0 to 9, got "2""#);
    let satellite = "satellite_id: must be an integer from 0 to 7, got 8";
    assert_eq!(fault("charge", json!({"satellite_id": 8})), satellite);
    assert_eq!(fault("charge", json!({"satellite": 1})), "satellite: the tool has no such argument");
}

#[test]
fn schemas_list_the_names_of_actions() {
    let entry = |task: usize| {
        wire_format(&TASKING_TASKS[task]).action_schema()["$defs"]["SatelliteAction"]["properties"]["action"]
            ["enum"]
            .as_array()
            .map(Vec::len)
    };
    assert_eq!([SCANNING, 1, CONSTELLATION].map(entry), [Some(4), Some(13), Some(13)]);
    let strict = wire_format(&TASKING_TASKS[SCANNING]).strict_schema();
    let action = &strict["properties"]["actions"]["items"]["properties"]["action"];
    assert_eq!(action["enum"], json!(["scan", "charge", "downlink", "desaturate"]));
}
