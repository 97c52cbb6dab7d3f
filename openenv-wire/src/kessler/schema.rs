//! The schemas of the public kessler-env, word for word, with three optional additions to the observation:
//! `target_separation`, `conjunctions` and `survival_probability`. Each is present only if a task or an option requires it.

use serde_json::Value;

use crate::schema::{
    action_metadata, described, list_of, message, mission_objective, model, number, observation_base, scalar,
    texts,
};

pub(super) const BURN: &str = "ThrusterBurn";
const SATELLITE: &str = "SatelliteTelemetry";
const DEBRIS: &str = "DebrisTelemetry";
const CONJUNCTION: &str = "ConjunctionTelemetry";

pub(super) fn action() -> Value {
    let burn = [
        ("satellite_id", described(scalar("integer"), "ID of the satellite to maneuver")),
        ("delta_vx", described(scalar("number"), "Change in X velocity (range: -1.0 to 1.0)")),
        ("delta_vy", described(scalar("number"), "Change in Y velocity (range: -1.0 to 1.0)")),
    ];
    let burns = "List of thruster maneuvers to execute. Leave empty for no burns.";
    message(
        "KesslerAction",
        "Action for the Kessler environment - assigning thruster burns to dodge debris.",
        &[action_metadata(), ("burns", described(list_of(BURN), burns))],
        &[],
        vec![model(BURN, &burn, &[])],
    )
}

pub(super) fn observation() -> Value {
    let [done, reward, metadata] = observation_base();
    let properties = [
        done,
        reward,
        metadata,
        mission_objective(),
        ("target_radius", number("If greater than 0, navigate Sat 0 to this orbital radius")),
        (
            "target_separation",
            number("If greater than 0, keep the satellites at this distance from each other"),
        ),
        ("satellites", described(list_of(SATELLITE), "Telemetry of your controlled satellites")),
        (
            "radar_debris",
            described(
                list_of(DEBRIS),
                "Debris within radar_range of at least one active satellite. Objects outside this range are not \
                 visible — plan accordingly.",
            ),
        ),
        (
            "conjunctions",
            described(
                list_of(CONJUNCTION),
                "Close passes ahead if no satellite burns, by satellite and time; present only if the option `warnings` is on",
            ),
        ),
        (
            "radar_range",
            number(
                "Sensor horizon in position units. Only debris within this distance of any active satellite appears \
                 in radar_debris. 0.0 means unlimited visibility (full observability mode).",
            ),
        ),
        ("critical_alerts", texts("Alerts such as collisions or low fuel")),
        ("total_score", number("Cumulative mission score")),
    ];
    message(
        "KesslerObservation",
        "Observation returning orbital telemetry and alerts.",
        &properties,
        &["satellites", "radar_debris"],
        models(),
    )
}

fn models() -> Vec<Value> {
    let number = || scalar("number");
    let body =
        || [("id", scalar("integer")), ("x", number()), ("y", number()), ("vx", number()), ("vy", number())];
    let survival = "Probability that the satellite is still active; present only under `risk: pc`";
    let satellite = [
        ("fuel", number()),
        ("status", described(scalar("string"), "'active' or 'destroyed'")),
        ("survival_probability", described(number(), survival)),
    ];
    let conjunction = [
        ("satellite_id", described(scalar("integer"), "ID of the satellite at risk")),
        ("debris_id", described(scalar("integer"), "ID of the debris")),
        ("time_to_closest_approach", described(number(), "Steps from now")),
        ("miss_distance", described(number(), "Distance at closest approach; below 2 is a collision")),
        ("relative_speed", described(number(), "Relative speed at closest approach")),
        ("probability", described(number(), "Probability of a collision")),
    ];
    let satellite: Vec<_> = body().into_iter().chain(satellite).collect();
    vec![
        model(SATELLITE, &satellite, &["survival_probability"]),
        model(DEBRIS, &body(), &[]),
        model(CONJUNCTION, &conjunction, &[]),
    ]
}
