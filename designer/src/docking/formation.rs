//! [`Formation`]: how several deputies start beside each other.

use env_core::KeyedRng;

use super::design::DeputyStart;
use super::vocabulary::{DISTANCE, ELEVATION};
use crate::angles::whole_degrees;

/// Geometry of the deputies of a layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Formation {
    /// In directions without a relation.
    Scattered,
    /// At one distance, side by side.
    Abreast {
        /// Angle between neighbours, in degrees.
        step_deg: i32,
    },
    /// In one direction, one behind the other.
    InLine {
        /// Distance added from one to the next, in percent of the first.
        step_percent: i32,
    },
    /// From opposite sides of the chief, in turn.
    Opposing,
}

impl Formation {
    /// Samples a formation, each kind as likely as the others.
    pub(super) fn sample(rng: &mut KeyedRng) -> Self {
        match rng.below(4) {
            0 => Self::Scattered,
            1 => Self::Abreast { step_deg: rng.range_inclusive(20, 60).cast_signed() },
            2 => Self::InLine { step_percent: rng.range_inclusive(12, 30).cast_signed() },
            _ => Self::Opposing,
        }
    }

    /// Moves a deputy to the `number`-th place of a formation whose first place, number 0, is that of `first`. Speeds stay.
    pub(super) fn place(
        self,
        deputy: DeputyStart,
        first: &DeputyStart,
        number: i32,
        rng: &mut KeyedRng,
    ) -> DeputyStart {
        let DeputyStart { azimuth_deg, elevation_deg, .. } = *first;
        match self {
            Self::Scattered => scatter(deputy, rng),
            Self::Abreast { step_deg } => DeputyStart {
                azimuth_deg: whole_degrees(f64::from(azimuth_deg + number * step_deg)).into(),
                elevation_deg,
                distance: first.distance,
                ..deputy
            },
            Self::InLine { step_percent } => {
                let farther =
                    DISTANCE.value(first.distance) * (1.0 + 0.01 * f64::from(number * step_percent));
                DeputyStart {
                    azimuth_deg,
                    elevation_deg,
                    distance: DISTANCE.nearest(farther + 2.0 * f64::from(number)),
                    ..deputy
                }
            }
            Self::Opposing => {
                // The second pair is at right angles to the first.
                let turned = azimuth_deg + 180 * number + 90 * (number / 2);
                let sign = if number % 2 == 0 { 1 } else { -1 };
                DeputyStart {
                    azimuth_deg: whole_degrees(f64::from(turned)).into(),
                    elevation_deg: sign * elevation_deg,
                    ..deputy
                }
            }
        }
    }
}

/// Moves a deputy to a random direction. Azimuth and elevation are uniform, as in the starts of the task, but elevations have at
/// most 60°.
pub(super) fn scatter(deputy: DeputyStart, rng: &mut KeyedRng) -> DeputyStart {
    let azimuth_deg = rng.below(360).cast_signed();
    let elevation_deg = ELEVATION.nearest(f64::from(rng.range_inclusive(0, 120)) - 60.0);
    DeputyStart { azimuth_deg, elevation_deg, ..deputy }
}
