//! The schemas of docking, in the form of kessler's.

use serde_json::{Value, json};

use crate::schema::{
    action_metadata, described, list_of, message, mission_objective, model, number, observation_base, scalar,
    texts,
};

pub(super) const THRUST: &str = "DeputyThrust";
const DEPUTY: &str = "DeputyTelemetry";
const NEAREST: &str = "NearestDeputy";
const REWARD: &str = "DeputyReward";

pub(super) fn action() -> Value {
    let thrust = |axis| {
        described(
            scalar("number"),
            &format!("Thrust {axis}, N, held for one second (range: -1.0 to 1.0, or less by thrust_bound)"),
        )
    };
    let entry = [
        ("deputy_id", described(scalar("integer"), "ID of the deputy to push")),
        ("thrust_x", thrust("radially out")),
        ("thrust_y", thrust("along the orbit")),
        ("thrust_z", thrust("across the orbit")),
    ];
    let thrusts = "List of thrusts for the next second. A deputy without one coasts.";
    message(
        "DockingAction",
        "Action for the docking environment - pushing deputies towards the chief.",
        &[action_metadata(), ("thrusts", described(list_of(THRUST), thrusts))],
        &[],
        vec![model(THRUST, &entry, &[])],
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
        ("time_limit_s", number("Time at which a deputy that has not docked has failed, s")),
        ("thrust_bound", number("Largest thrust per axis, N; more is clamped")),
        ("docking_radius", number("Within this distance of the chief a deputy docks or crashes, m")),
        (
            "deputies",
            described(
                list_of(DEPUTY),
                "Telemetry of your deputies. The chief is at the origin; x points radially out, y along its orbit, z \
                 across it.",
            ),
        ),
        ("critical_alerts", texts("Events of the last step, and deputies above the speed limit now")),
        ("total_score", number("Cumulative mission score: the sum of rewards")),
    ];
    message(
        "DockingObservation",
        "Observation returning the deputies' motion relative to the chief, and alerts.",
        &properties,
        &["deputies"],
        models(),
    )
}

fn models() -> Vec<Value> {
    let number = |text| described(scalar("number"), text);
    let integer = |text| described(scalar("integer"), text);
    let axes = ["x", "y", "z"].map(|axis| (axis, number("m")));
    let speeds = ["vx", "vy", "vz"].map(|axis| (axis, number("m/s")));
    let status = "active, docked, crashed, out_of_bounds, saturated, collided or timed_out";
    let eight = json!({"type": "array", "items": scalar("number"), "minItems": 8, "maxItems": 8});
    let nearest = json!({"anyOf": [{"$ref": format!("#/$defs/{NEAREST}")}, {"type": "null"}]});
    let deputy = [("id", scalar("integer")), ("status", described(scalar("string"), status))]
        .into_iter()
        .chain(axes)
        .chain(speeds)
        .chain([
            ("distance", number("From the chief, m")),
            ("speed", number("Relative to the chief, m/s")),
            ("speed_limit", number("The speed limit here, m/s")),
            ("observation", described(eight, "Position/100 m, velocity/0.5 m/s, speed, speed limit")),
            ("nearest", described(nearest, "The nearest other active deputy")),
            (
                "velocity_penalty",
                number("Sum of the penalties for exceeding the speed limit; at -5 the deputy is stopped"),
            ),
            ("reward", json!({"$ref": format!("#/$defs/{REWARD}")})),
            ("total_reward", number("The sum of its rewards")),
        ]);
    let near = [
        ("id", integer("ID of that deputy")),
        ("distance", number("Distance, m")),
        ("relative_speed", number("Relative to this one, m/s")),
    ];
    let reward = [
        ("distance", number("For approaching the chief")),
        ("delta_v", number("For the thrust")),
        ("velocity", number("For breaking the speed limit")),
        ("success", number("For docking")),
        ("failure", number("For a timeout, leaving bounds or a crash")),
    ];
    vec![
        model(DEPUTY, &deputy.collect::<Vec<_>>(), &[]),
        model(NEAREST, &near, &[]),
        model(REWARD, &reward, &[]),
    ]
}
