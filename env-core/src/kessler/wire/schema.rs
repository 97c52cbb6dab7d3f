//! The schemas of the public kessler-env, word for word, and what our observation has more: `target_separation`,
//! `conjunctions`, `survival_probability`, each there only where a task or an option asks for it.

use serde_json::{Value, json};

use crate::wire::schema::{action_metadata, list_of, message, model, observation_base, or, scalar, told};

pub(super) const BURN: &str = "ThrusterBurn";
const SATELLITE: &str = "SatelliteTelemetry";
const DEBRIS: &str = "DebrisTelemetry";
const CONJUNCTION: &str = "ConjunctionTelemetry";

pub(super) fn action() -> Value {
    let burn = [
        ("satellite_id", told(scalar("integer"), "ID of the satellite to maneuver")),
        ("delta_vx", told(scalar("number"), "Change in X velocity (range: -1.0 to 1.0)")),
        ("delta_vy", told(scalar("number"), "Change in Y velocity (range: -1.0 to 1.0)")),
    ];
    let burns = "List of thruster maneuvers to execute. Leave empty for no burns.";
    message(
        "KesslerAction",
        "Action for the Kessler environment - assigning thruster burns to dodge debris.",
        &[action_metadata(), ("burns", told(list_of(BURN), burns))],
        &[],
        vec![model(BURN, &burn, &[])],
    )
}

pub(super) fn observation() -> Value {
    let [done, reward, metadata] = observation_base();
    let text = |about| or(told(scalar("string"), about), json!(""));
    let number = |about| or(told(scalar("number"), about), json!(0.0));
    let alerts = json!({"type": "array", "items": {"type": "string"}});
    let properties = [
        done,
        reward,
        metadata,
        ("mission_objective", text("The goal for the current episode")),
        ("target_radius", number("If greater than 0, navigate Sat 0 to this orbital radius")),
        (
            "target_separation",
            number("If greater than 0, keep the satellites at this distance from each other"),
        ),
        ("satellites", told(list_of(SATELLITE), "Telemetry of your controlled satellites")),
        (
            "radar_debris",
            told(
                list_of(DEBRIS),
                "Debris within radar_range of at least one active satellite. Objects outside this range are not \
                 visible — plan accordingly.",
            ),
        ),
        (
            "conjunctions",
            told(
                list_of(CONJUNCTION),
                "Close passes to come if nobody burns, by satellite and time; there only if warnings are asked for",
            ),
        ),
        (
            "radar_range",
            number(
                "Sensor horizon in position units. Only debris within this distance of any active satellite appears \
                 in radar_debris. 0.0 means unlimited visibility (full observability mode).",
            ),
        ),
        ("critical_alerts", told(alerts, "Alerts such as collisions or low fuel")),
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
    let survival = "Probability that it still flies; there only under risk: pc";
    let satellite = [
        ("fuel", number()),
        ("status", told(scalar("string"), "'active' or 'destroyed'")),
        ("survival_probability", told(number(), survival)),
    ];
    let conjunction = [
        ("satellite_id", told(scalar("integer"), "Whom it warns")),
        ("debris_id", told(scalar("integer"), "Of what")),
        ("time_to_closest_approach", told(number(), "Steps from now")),
        ("miss_distance", told(number(), "Distance then; below 2 is a collision")),
        ("relative_speed", told(number(), "Speed of one as seen from the other then")),
        ("probability", told(number(), "Probability of a collision")),
    ];
    let satellite: Vec<_> = body().into_iter().chain(satellite).collect();
    vec![
        model(SATELLITE, &satellite, &["survival_probability"]),
        model(DEBRIS, &body(), &[]),
        model(CONJUNCTION, &conjunction, &[]),
    ]
}
