//! Observations of kessler as text for a language model: threats to each satellite instead of a raw list of debris.

use std::fmt::Write;

use env_core::TaskSpec;
use env_core::kessler::constants::{CONTACT_DISTANCE, FORMATION_SIDE, HORIZON};
use env_core::kessler::kernel::{Body, Gravity};
use env_core::kessler::telemetry::{DebrisTelemetry, KesslerTelemetry, SatelliteTelemetry};
use serde_json::Value;

/// Number of steps in a kessler episode.
pub(super) const STEPS: u32 = HORIZON;
/// Description of an action for the system message.
pub(super) const ACTION_FORM: &str = "The object is {\"burns\": [...]}, with at most one burn for each satellite: {\"satellite_id\": number, \
                               \"delta_vx\": number, \"delta_vy\": number}. {\"burns\": []} does nothing.";
/// Number of steps over which threats are predicted, by the plain dynamics and under *hold*.
const THREAT_LOOK_AHEAD: u32 = 10;
/// Maximum number of threats listed for each satellite.
const MAX_THREATS: usize = 4;
/// Debris is a threat if it comes nearer than this, in LU.
const THREAT_DISTANCE: f64 = 10.0;
/// Maximum number of conjunction warnings that are listed.
const MAX_WARNINGS: usize = 12;

/// Returns true if a task belongs to kessler.
pub(super) fn is_kessler(task: &dyn TaskSpec) -> bool {
    task.world() == env_core::kessler::WORLD_ID
}

/// Formats an observation as tables; `None` if it is not an observation of kessler.
pub(super) fn format_observation(observation: &Value) -> Option<String> {
    let telemetry: KesslerTelemetry = serde_json::from_value(observation.clone()).ok()?;
    let mut text =
        "Satellites (r: orbit radius; out: unit vector away from the Earth; ahead: prograde):\n".to_owned();
    text.push_str("satellite, x, y, vx, vy, r, out, ahead, fuel\n");
    for satellite in &telemetry.satellites {
        write_satellite(satellite, &mut text);
    }
    write_goal(&telemetry, &mut text);
    write_threats(&telemetry, &mut text);
    write_warnings(&telemetry, &mut text);
    if !telemetry.critical_alerts.is_empty() {
        let _ = write!(text, "\nIn the last step: {}", telemetry.critical_alerts.join(" "));
    }
    Some(text)
}

/// Formats a number with `decimals` decimals; zero has no sign.
fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    if text.bytes().all(|b| matches!(b, b'-' | b'0' | b'.')) { text.replace('-', "") } else { text }
}

/// Formats a vector with two decimals.
fn vector([x, y]: [f64; 2]) -> String {
    format!("({} {})", fixed(x, 2), fixed(y, 2))
}

// The results of `write!` are ignored below: writing to a string cannot fail.

/// Writes the row of one satellite.
fn write_satellite(satellite: &SatelliteTelemetry, text: &mut String) {
    let SatelliteTelemetry { id, x, y, vx, vy, fuel, .. } = satellite;
    if !satellite.is_active() {
        let _ = writeln!(text, "{id}, destroyed");
        return;
    }
    let body = satellite.body();
    let (out, ahead) = body.local_axes();
    let [x, y] = [*x, *y].map(|value| fixed(value, 1));
    let [vx, vy] = [*vx, *vy].map(|value| fixed(value, 2));
    let (out, ahead) = (vector(out.into()), vector(ahead.into()));
    let _ = write!(text, "{id}, {x}, {y}, {vx}, {vy}, {:.1}, {out}, {ahead}, {fuel:.1}", body.radius());
    let survives = satellite.survival_probability.map(|p| format!(", survives with probability {p:.3}"));
    let _ = writeln!(text, "{}", survives.unwrap_or_default());
}

/// Writes how far the satellites are from the task's target radius or separation.
fn write_goal(telemetry: &KesslerTelemetry, text: &mut String) {
    let active = |id: usize| telemetry.satellites.get(id).filter(|satellite| satellite.is_active());
    if let Some(satellite) = active(0).filter(|_| telemetry.target_radius > 0.0) {
        let body = satellite.body();
        let ((ox, oy), (ax, ay)) = body.local_axes();
        let (out, ahead) = (body.vx * ox + body.vy * oy, body.vx * ax + body.vy * ay);
        let _ = writeln!(
            text,
            "Target radius of satellite 0: {:.0}; it is at {:.1}, its speed {} out and {} ahead.",
            telemetry.target_radius,
            body.radius(),
            fixed(out, 2),
            fixed(ahead, 2)
        );
    }
    if telemetry.target_separation > 0.0 {
        let pairs = [(0, 1), (0, 2), (1, 2)].into_iter().filter_map(|(a, b)| {
            let (first, second) = (active(a)?.body(), active(b)?.body());
            let distance = libm::hypot(first.x - second.x, first.y - second.y);
            Some(format!("{a}-{b} {distance:.1}"))
        });
        let distances: Vec<String> = pairs.collect();
        let _ = writeln!(text, "Distances (target {FORMATION_SIDE:.0}): {}.", distances.join(", "));
    }
}

/// Closest approach of one piece of debris to one satellite under *hold*.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Threat {
    satellite: u32,
    debris: u32,
    /// Distance now, in LU.
    distance: f64,
    /// Distance at the closest approach, in LU.
    min_distance: f64,
    /// Number of steps until the closest approach.
    step: u32,
    /// Unit vector from the satellite to the debris at the closest approach.
    direction: (f64, f64),
    /// Relative speed at the closest approach.
    speed: f64,
}

/// Writes the nearest threats to each satellite.
fn write_threats(telemetry: &KesslerTelemetry, text: &mut String) {
    let mut threats: Vec<Threat> = Vec::new();
    for satellite in telemetry.satellites.iter().filter(|satellite| satellite.is_active()) {
        let all = telemetry.radar_debris.iter().map(|debris| predict_threat(satellite, debris));
        let mut near: Vec<Threat> = all.filter(|threat| threat.min_distance < THREAT_DISTANCE).collect();
        near.sort_by(|a, b| a.min_distance.total_cmp(&b.min_distance));
        threats.extend(near.into_iter().take(MAX_THREATS));
    }
    let range = if telemetry.radar_range > 0.0 {
        format!(", radar range {:.0}", telemetry.radar_range)
    } else {
        String::new()
    };
    let pieces = telemetry.radar_debris.len();
    if threats.is_empty() {
        let _ = writeln!(
            text,
            "Debris: {pieces} pieces visible{range}; within {THREAT_LOOK_AHEAD} steps none comes nearer than \
             {THREAT_DISTANCE:.0} if no satellite burns."
        );
        return;
    }
    let _ = writeln!(
        text,
        "Debris: {pieces} pieces visible{range}; these come nearer than {THREAT_DISTANCE:.0} within {THREAT_LOOK_AHEAD} steps \
         if no satellite burns (side: unit vector from the satellite to the debris at the closest approach):\n\
         satellite, debris, distance now, closest distance, in steps, side, relative speed"
    );
    for threat in threats {
        let Threat { satellite, debris, distance, min_distance, step, direction, speed } = threat;
        let hit = if min_distance < CONTACT_DISTANCE { " HIT" } else { "" };
        let _ = writeln!(
            text,
            "{satellite}, {debris}, {distance:.1}, {min_distance:.1}{hit}, {step}, {}, {speed:.1}",
            vector(direction.into())
        );
    }
}

/// State of a satellite and a piece of debris at one step of the prediction.
#[derive(Clone, Copy)]
struct Approach {
    distance: f64,
    step: u32,
    satellite: Body,
    debris: Body,
}

/// Predicts the closest approach within [`THREAT_LOOK_AHEAD`] steps.
fn predict_threat(satellite: &SatelliteTelemetry, debris: &DebrisTelemetry) -> Threat {
    let at = |step: u32, satellite: Body, debris: Body| {
        let distance = libm::hypot(debris.x - satellite.x, debris.y - satellite.y);
        Approach { distance, step, satellite, debris }
    };
    let start = at(0, satellite.body(), debris.body());
    let mut last = start;
    let mut closest: Option<Approach> = None;
    for step in 1..=THREAT_LOOK_AHEAD {
        last = at(step, last.satellite.coast(Gravity::Point), last.debris.coast(Gravity::Point));
        if closest.is_none_or(|closest| last.distance < closest.distance) {
            closest = Some(last);
        }
    }
    let Approach { distance, step, satellite: own, debris: other } = closest.unwrap_or(start);
    let length = distance.max(1e-9);
    Threat {
        satellite: satellite.id,
        debris: debris.id,
        distance: start.distance,
        min_distance: distance,
        step,
        direction: ((other.x - own.x) / length, (other.y - own.y) / length),
        speed: libm::hypot(other.vx - own.vx, other.vy - own.vy),
    }
}

/// Writes the operator's conjunction warnings, if the observation has any.
fn write_warnings(telemetry: &KesslerTelemetry, text: &mut String) {
    let Some(warnings) = telemetry.conjunctions.as_ref().filter(|warnings| !warnings.is_empty()) else {
        return;
    };
    let _ = writeln!(
        text,
        "Conjunction warnings:\nsatellite, debris, in steps, miss distance, probability of a collision"
    );
    for warning in warnings.iter().take(MAX_WARNINGS) {
        let _ = writeln!(
            text,
            "{}, {}, {:.1}, {:.1}, {:.1e}",
            warning.satellite_id,
            warning.debris_id,
            warning.time_to_closest_approach,
            warning.miss_distance,
            warning.probability
        );
    }
}
