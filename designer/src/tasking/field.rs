//! Places the targets of a field beside the path of a satellite.

use env_core::tasking::constants::EARTH_RADIUS_M;
use env_core::tasking::task::forecast::{SatelliteForecast, TRACK_STEP_S};
use env_core::tasking::task::layout::TargetPlace;
use env_core::tasking::vector3::{Vector3, add, cross, norm, scale, sub};

use super::design::TargetField;
use super::units::{M_PER_KM, S_PER_MINUTE};

/// Angle between two targets of a spiral that fills a disc evenly, rad: the golden angle (Vogel 1979).
const GOLDEN_ANGLE_RAD: f64 = 2.399_963_229_728_653;
/// Steps in the order of priorities from one target to the next, as a share of all: the golden ratio mixes them evenly.
const GOLDEN_RATIO: f64 = 0.618_033_988_749_894_9;

/// Directions on the ground at a moment of a path, of length 1.
struct GroundFrame {
    up: Vector3<f64>,
    ahead: Vector3<f64>,
    right: Vector3<f64>,
}

impl GroundFrame {
    /// The frame at a time, s; `None` beyond the path.
    fn at(path: &SatelliteForecast, time_s: f64) -> Option<Self> {
        let (before, after) = (path.point_at(time_s - TRACK_STEP_S)?, path.point_at(time_s + TRACK_STEP_S)?);
        let up = path.point_at(time_s)?.direction;
        let right = unit(&cross(&sub(&after.direction, &before.direction), &up));
        Some(Self { up, ahead: cross(&up, &right), right })
    }

    /// Direction of the ground at distances ahead and to the right, m, along great circles.
    fn place(&self, ahead_m: f64, right_m: f64) -> Vector3<f64> {
        let distance = (ahead_m * ahead_m + right_m * right_m).sqrt();
        if distance <= 0.0 {
            return self.up;
        }
        let sideways = add(&scale(&self.ahead, ahead_m / distance), &scale(&self.right, right_m / distance));
        let (sine, cosine) = libm::sincos(distance / EARTH_RADIUS_M);
        add(&scale(&self.up, cosine), &scale(&sideways, sine))
    }
}

/// Places the targets of a field; `None` if the path ends before.
pub(super) fn place_targets(field: &TargetField, path: &SatelliteForecast) -> Option<Vec<TargetPlace>> {
    let frame = GroundFrame::at(path, f64::from(field.minute) * S_PER_MINUTE)?;
    let count = f64::from(field.targets);
    let (low, high) = (f64::from(field.priority_low), f64::from(field.priority_high));
    let target = |number: i32| {
        let number = f64::from(number);
        let radius_m = f64::from(field.spread_km) * M_PER_KM * ((number + 0.5) / count).sqrt();
        let (sine, cosine) = libm::sincos(number * GOLDEN_ANGLE_RAD);
        let right_m = f64::from(field.offset_km) * M_PER_KM + radius_m * sine;
        let mixed = number * GOLDEN_RATIO;
        let share = if count > 1.0 { mixed - libm::floor(mixed) } else { 1.0 };
        let priority = (low + share * (high - low)) / 100.0;
        place_of(&frame.place(radius_m * cosine, right_m), priority)
    };
    Some((0..field.targets).map(target).collect())
}

/// Returns the middle of a field, with its highest priority; `None` if the path ends before.
pub(super) fn field_centre(field: &TargetField, path: &SatelliteForecast) -> Option<TargetPlace> {
    let frame = GroundFrame::at(path, f64::from(field.minute) * S_PER_MINUTE)?;
    let middle = frame.place(0.0, f64::from(field.offset_km) * M_PER_KM);
    Some(place_of(&middle, f64::from(field.priority_high) / 100.0))
}

/// Returns the place of a direction, rounded to 11 m, and a priority, rounded to four decimals.
fn place_of(direction: &Vector3<f64>, priority: f64) -> TargetPlace {
    let round = |value: f64| libm::round(value * 1e4) / 1e4;
    let unit = unit(direction);
    let longitude = libm::atan2(unit[1], unit[0]).to_degrees();
    let latitude = libm::asin(unit[2].clamp(-1.0, 1.0)).to_degrees();
    TargetPlace::at((round(longitude), round(latitude)), round(priority))
}

fn unit(vector: &Vector3<f64>) -> Vector3<f64> {
    scale(vector, 1.0 / norm(vector).max(f64::MIN_POSITIVE))
}
