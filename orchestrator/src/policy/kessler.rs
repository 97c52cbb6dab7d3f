//! What a language model is told of kessler: debris as it threatens each satellite instead of a raw list.

use std::fmt::Write;

use env_core::TaskSpec;
use env_core::kessler::constants::{CONTACT_DISTANCE, FORMATION_SIDE, HORIZON};
use env_core::kessler::kernel::{Body, Gravity};
use env_core::kessler::telemetry::{DebrisTelemetry, SatelliteTelemetry, Telemetry};
use serde_json::Value;

/// Steps foreseen, by the plain dynamics and under hold.
const LOOK_AHEAD: u32 = 10;
/// Debris told of per satellite, at most.
const THREATS: usize = 4;
/// Debris that does not come nearer than this, LU, is not told of.
const NEAR: f64 = 10.0;
/// Conjunction warnings told, at most.
const WARNINGS: usize = 12;

/// Whether a task is of this world.
pub(super) fn flies(task: &dyn TaskSpec) -> bool {
    task.world() == env_core::kessler::WORLD
}

/// Steps of an episode.
pub(super) const STEPS: u32 = HORIZON;

/// What an action looks like, in words.
pub(super) const FORM: &str = "It is {\"burns\": [...]}, with at most one burn a satellite: {\"satellite_id\": number, \
                               \"delta_vx\": number, \"delta_vy\": number}. {\"burns\": []} does nothing.";

/// An observation as tables; none where it is not one of this world.
pub(super) fn compact(seen: &Value) -> Option<String> {
    let seen: Telemetry = serde_json::from_value(seen.clone()).ok()?;
    let mut text =
        "Satellites (r: orbit radius; out: unit vector away from the Earth; ahead: prograde):\n".to_owned();
    text.push_str("satellite, x, y, vx, vy, r, out, ahead, fuel\n");
    for satellite in &seen.satellites {
        row(satellite, &mut text);
    }
    goal(&seen, &mut text);
    threats(&seen, &mut text);
    warnings(&seen, &mut text);
    if !seen.critical_alerts.is_empty() {
        let _ = write!(text, "\nIn the last step: {}", seen.critical_alerts.join(" "));
    }
    Some(text)
}

/// A number with so many decimals; zero has no sign.
fn n(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    if text.bytes().all(|b| matches!(b, b'-' | b'0' | b'.')) { text.replace('-', "") } else { text }
}

/// A vector.
fn v((x, y): (f64, f64)) -> String {
    format!("({} {})", n(x, 2), n(y, 2))
}

// Writing to a string cannot fail.
fn row(satellite: &SatelliteTelemetry, text: &mut String) {
    let SatelliteTelemetry { id, x, y, vx, vy, fuel, .. } = satellite;
    if !satellite.active() {
        let _ = writeln!(text, "{id}, destroyed");
        return;
    }
    let body = satellite.body();
    let (out, ahead) = body.frame();
    let [x, y] = [*x, *y].map(|value| n(value, 1));
    let [vx, vy] = [*vx, *vy].map(|value| n(value, 2));
    let _ =
        write!(text, "{id}, {x}, {y}, {vx}, {vy}, {:.1}, {}, {}, {fuel:.1}", body.radius(), v(out), v(ahead));
    let survives = satellite.survival_probability.map(|p| format!(", survives with probability {p:.3}"));
    let _ = writeln!(text, "{}", survives.unwrap_or_default());
}

fn goal(seen: &Telemetry, text: &mut String) {
    let flying = |id: usize| seen.satellites.get(id).filter(|satellite| satellite.active());
    if let Some(satellite) = flying(0).filter(|_| seen.target_radius > 0.0) {
        let body = satellite.body();
        let ((ox, oy), (ax, ay)) = body.frame();
        let (out, ahead) = (body.vx * ox + body.vy * oy, body.vx * ax + body.vy * ay);
        let _ = writeln!(
            text,
            "Target radius of satellite 0: {:.0}; it is at {:.1}, its speed {} out and {} ahead.",
            seen.target_radius,
            body.radius(),
            n(out, 2),
            n(ahead, 2)
        );
    }
    if seen.target_separation > 0.0 {
        let pairs = [(0, 1), (0, 2), (1, 2)].into_iter().filter_map(|(a, b)| {
            let (first, second) = (flying(a)?.body(), flying(b)?.body());
            let apart = libm::hypot(first.x - second.x, first.y - second.y);
            Some(format!("{a}-{b} {apart:.1}"))
        });
        let told: Vec<String> = pairs.collect();
        let _ = writeln!(text, "Distances, {FORMATION_SIDE:.0} is wanted: {}.", told.join(", "));
    }
}

/// Debris where it comes nearest to a satellite, both under hold.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Threat {
    satellite: u32,
    debris: u32,
    now: f64,
    nearest: f64,
    step: u32,
    /// Unit vector from the satellite to the debris then.
    side: (f64, f64),
    /// Relative speed then.
    speed: f64,
}

fn threats(seen: &Telemetry, text: &mut String) {
    let mut told: Vec<Threat> = Vec::new();
    for satellite in seen.satellites.iter().filter(|satellite| satellite.active()) {
        let all = seen.radar_debris.iter().map(|debris| foreseen(satellite, debris));
        let mut near: Vec<Threat> = all.filter(|threat| threat.nearest < NEAR).collect();
        near.sort_by(|a, b| a.nearest.total_cmp(&b.nearest));
        told.extend(near.into_iter().take(THREATS));
    }
    let range = if seen.radar_range > 0.0 {
        format!(", radar sees {:.0} far", seen.radar_range)
    } else {
        String::new()
    };
    let pieces = seen.radar_debris.len();
    if told.is_empty() {
        let _ = writeln!(
            text,
            "Debris: {pieces} pieces in sight{range}; within {LOOK_AHEAD} steps none comes nearer than {NEAR:.0} if \
             nobody burns."
        );
        return;
    }
    let _ = writeln!(
        text,
        "Debris: {pieces} pieces in sight{range}; what comes nearer than {NEAR:.0} within {LOOK_AHEAD} steps if nobody \
         burns (side: unit vector from the satellite to where it is nearest):\n\
         satellite, debris, distance now, nearest, in steps, side, relative speed"
    );
    for threat in told {
        let Threat { satellite, debris, now, nearest, step, side, speed } = threat;
        let hit = if nearest < CONTACT_DISTANCE { " HIT" } else { "" };
        let _ = writeln!(
            text,
            "{satellite}, {debris}, {now:.1}, {nearest:.1}{hit}, {step}, {}, {speed:.1}",
            v(side)
        );
    }
}

fn foreseen(satellite: &SatelliteTelemetry, debris: &DebrisTelemetry) -> Threat {
    let (mut own, mut other) = (satellite.body(), debris.body());
    let apart = |own: &Body, other: &Body| libm::hypot(other.x - own.x, other.y - own.y);
    let now = apart(&own, &other);
    let mut nearest: Option<(f64, u32, Body, Body)> = None;
    for step in 1..=LOOK_AHEAD {
        (own, other) = (own.coasted(Gravity::Point), other.coasted(Gravity::Point));
        let distance = apart(&own, &other);
        if nearest.is_none_or(|(least, ..)| distance < least) {
            nearest = Some((distance, step, own, other));
        }
    }
    let (nearest, step, own, other) = nearest.unwrap_or((now, 0, own, other));
    let length = nearest.max(1e-9);
    Threat {
        satellite: satellite.id,
        debris: debris.id,
        now,
        nearest,
        step,
        side: ((other.x - own.x) / length, (other.y - own.y) / length),
        speed: libm::hypot(other.vx - own.vx, other.vy - own.vy),
    }
}

fn warnings(seen: &Telemetry, text: &mut String) {
    let Some(warnings) = seen.conjunctions.as_ref().filter(|warnings| !warnings.is_empty()) else { return };
    let _ =
        writeln!(text, "Warnings of the operator:\nsatellite, debris, in, miss, probability of a collision");
    for warning in warnings.iter().take(WARNINGS) {
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
