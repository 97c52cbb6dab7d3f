//! The schemas of tasking, in the form of kessler's.

use serde_json::{Value, json};

use crate::schema::{
    action_metadata, described, list_of, message, mission_objective, model, number, observation_base, scalar,
    texts,
};

pub(super) const ACTIONS: &str = "actions";
pub(super) const ACTION: &str = "SatelliteAction";
pub(super) const SATELLITE_ID: &str = "satellite_id";
pub(super) const NAME: &str = "action";
const SATELLITE: &str = "TaskedSatelliteTelemetry";
const TARGET: &str = "TargetTelemetry";

pub(super) fn action(names: &[&str]) -> Value {
    let entry = [
        (SATELLITE_ID, described(scalar("integer"), "ID of the satellite")),
        (NAME, described(json!({"type": "string", "enum": names}), "Name of the action, or its index")),
    ];
    let actions = "List of new actions. A satellite without one goes on with its action. The step ends when the first \
                   satellite has finished.";
    message(
        "TaskingAction",
        "Action for the tasking environment - choosing what satellites do next.",
        &[action_metadata(), (ACTIONS, described(list_of(ACTION), actions))],
        &[],
        vec![model(ACTION, &entry, &[])],
    )
}

pub(super) fn observation() -> Value {
    let [done, reward, metadata] = observation_base();
    let properties = [
        done,
        reward,
        metadata,
        mission_objective(),
        ("time_s", number("Elapsed time, s")),
        ("time_limit_s", number("Time at which the episode ends, s")),
        ("actions", texts("Names of the actions, by index")),
        ("satellites", described(list_of(SATELLITE), "Telemetry of your satellites")),
        ("critical_alerts", texts("Events of the last step")),
        ("total_score", number("Cumulative mission score: the sum of rewards")),
    ];
    message(
        "TaskingObservation",
        "Observation returning the satellites' resources, pointing and opportunities.",
        &properties,
        &["satellites"],
        models(),
    )
}

fn models() -> Vec<Value> {
    let number = |text| described(scalar("number"), text);
    let boolean = |text| described(scalar("boolean"), text);
    let three = json!({"type": "array", "items": scalar("number"), "minItems": 3, "maxItems": 3});
    let satellite = [
        ("id", scalar("integer")),
        ("alive", boolean("False if the satellite has died")),
        ("needs_action", boolean("True if it needs an action; false while it is busy")),
        (
            "action",
            described(
                json!({"anyOf": [scalar("string"), {"type": "null"}]}),
                "Name of the last action; null before the first",
            ),
        ),
        ("battery", number("Charge as a share of the capacity; at 0 the satellite dies")),
        ("storage", number("Data as a share of the capacity; full storage takes no more data")),
        (
            "wheels",
            described(three, "Speeds of the wheels as shares of the limit; at 1 or -1 the satellite dies"),
        ),
        ("instrument_error_deg", number("Angle between the instrument and nadir, degrees")),
        ("sun_error_deg", number("Angle between the solar panel's normal and the Sun, degrees")),
        ("eclipse_start_s", number("Time until the next eclipse begins, s")),
        ("eclipse_end_s", number("Time until the next end of an eclipse, s")),
        ("station_open_s", number("Time until a ground station can be reached, s; negative if one can")),
        ("station_close_s", number("Time until it cannot be reached any more, s")),
        (
            "targets",
            described(
                list_of(TARGET),
                "The next targets, by index, as in the action image_0, image_1, …; empty if there are none",
            ),
        ),
    ];
    let target = [
        ("priority", number("Value of an image of the target")),
        ("open_s", number("Time until the target can be imaged, s; negative if it can")),
        ("close_s", number("Time until it cannot be imaged any more, s")),
        ("angle_deg", number("Angle between the instrument and the target, degrees")),
    ];
    vec![model(SATELLITE, &satellite, &[]), model(TARGET, &target, &[])]
}
