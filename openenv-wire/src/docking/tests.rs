//! Reading thrusts, and the schemas of docking.

use env_core::docking::DOCKING_TASKS;
use env_core::log::{ActionLog, Precision};
use serde_json::{Value, json};

use crate::wire_format;

fn read_action(action: &Value) -> Result<ActionLog, Value> {
    let mut log = ActionLog::new(3, Precision::F64);
    wire_format(&DOCKING_TASKS[1])
        .read_action(action, &mut log)
        .map_err(|errors| serde_json::to_value(errors).unwrap())?;
    Ok(log)
}

#[test]
fn thrusts_are_read_in_every_form() {
    let thrusts = json!([
        {"deputy_id": 2, "thrust_x": 0.5, "thrust_y": "-0.25", "thrust_z": true, "note": "ignored"},
        {"deputy_id": "0", "thrust_x": 0, "thrust_y": 0, "thrust_z": -1},
        {"deputy_id": 5, "thrust_x": 1, "thrust_y": 1, "thrust_z": 1},
    ]);
    for action in [
        json!({"thrusts": thrusts, "metadata": {"k": 1}}),
        json!({"thrusts": thrusts.to_string()}),
        json!({"thrusts": json!({"thrusts": thrusts}).to_string()}),
        json!({"thrusts": json!({"action": {"thrusts": thrusts}}).to_string()}),
    ] {
        let log = read_action(&action).unwrap();
        assert_eq!(log.step(0).agents, [2, 0]);
        assert_eq!(log.step(0).values, [0.5, -0.25, 1.0, 0.0, 0.0, -1.0]);
    }
    assert_eq!(read_action(&json!({})).unwrap().step(0).agents.len(), 0);
}

#[test]
fn errors_name_deputy_and_axis() {
    let errors = read_action(
        &json!({"thrusts": [{"deputy_id": 1.5, "thrust_x": "x", "thrust_z": "inf"}], "burns": []}),
    );
    let entry = json!({"deputy_id": 1.5, "thrust_x": "x", "thrust_z": "inf"});
    let parsing = |what| format!("Input should be a valid {what}");
    assert_eq!(
        errors.unwrap_err(),
        json!([
            {
                "type": "int_from_float", "loc": ["thrusts", 0, "deputy_id"],
                "msg": parsing("integer, got a number with a fractional part"), "input": 1.5,
            },
            {
                "type": "float_parsing", "loc": ["thrusts", 0, "thrust_x"],
                "msg": parsing("number, unable to parse string as a number"), "input": "x",
            },
            {"type": "missing", "loc": ["thrusts", 0, "thrust_y"], "msg": "Field required", "input": entry},
            {
                "type": "finite_number", "loc": ["thrusts", 0, "thrust_z"],
                "msg": "Input should be a finite number", "input": "inf",
            },
            {"type": "extra_forbidden", "loc": ["burns"], "msg": "Extra inputs are not permitted", "input": []},
        ])
    );
}

#[test]
fn schemas_have_the_form_of_kessler() {
    let action = wire_format(&DOCKING_TASKS[0]).action_schema();
    assert_eq!(action["additionalProperties"], false);
    assert_eq!(action["properties"]["thrusts"]["items"]["$ref"], "#/$defs/DeputyThrust");
    let entry = &action["$defs"]["DeputyThrust"];
    assert_eq!(entry["required"], json!(["deputy_id", "thrust_x", "thrust_y", "thrust_z"]));
    assert_eq!(entry["properties"]["thrust_x"]["title"], "Thrust X");
    let observation = wire_format(&DOCKING_TASKS[0]).observation_schema();
    assert_eq!(observation["required"], json!(["deputies"]));
    for base in ["done", "reward", "metadata"] {
        assert!(observation["properties"][base].is_object(), "{base}");
    }
}
