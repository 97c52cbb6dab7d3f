//! The blind panel: 16 plans that look at nothing.

use super::table::Path;
use super::table::Table;
use crate::kessler::constants::FUEL_PER_SPEED;
use crate::kessler::kernel::Body;

/// Plans of the panel.
pub const PANEL: usize = 16;
/// Sizes of the kicks, LU/TU, each in four directions; the last in three.
const SIZES: [f64; 4] = [0.05, 0.1, 0.2, 0.4];
/// Keeps a kick that takes all fuel from being refused by one rounding.
const WITHIN_FUEL: f64 = 1.0 - 1e-12;

/// A direction in a satellite's own frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Along the motion of a prograde orbit.
    Prograde,
    /// Away from the Earth.
    RadialOut,
    /// Against it.
    Retrograde,
    /// Towards the Earth.
    RadialIn,
}

const DIRECTIONS: [Direction; 4] =
    [Direction::Prograde, Direction::RadialOut, Direction::Retrograde, Direction::RadialIn];

impl Direction {
    /// The unit vector for this body.
    #[must_use]
    pub fn of(self, body: &Body) -> (f64, f64) {
        let ((rx, ry), (tx, ty)) = body.frame();
        match self {
            Self::Prograde => (tx, ty),
            Self::RadialOut => (rx, ry),
            Self::Retrograde => (-tx, -ty),
            Self::RadialIn => (-rx, -ry),
        }
    }
}

/// The largest kick up to `size` that `fuel` allows.
#[must_use]
pub fn capped(size: f64, fuel: f64) -> f64 {
    size.min(fuel / FUEL_PER_SPEED * WITHIN_FUEL)
}

/// Plan `index` of the panel for one satellite: `None` for hold, else the kick at step 0 as (dvx, dvy).
#[must_use]
pub fn kick(index: usize, body: &Body, fuel: f64) -> Option<(f64, f64)> {
    let number = index.checked_sub(1)?;
    let (dx, dy) = DIRECTIONS[number % 4].of(body);
    let size = capped(SIZES[number / 4], fuel);
    Some((size * dx, size * dy))
}

/// The whole panel flown for one satellite.
pub(super) fn fly(table: &Table, body: Body, fuel: f64) -> Vec<Path> {
    (0..PANEL)
        .map(|index| {
            let mut path = Path::start(body, fuel);
            if path.advance(table, 1, kick(index, &body, fuel)) {
                path.fly(table, 2, &[]);
            }
            path
        })
        .collect()
}
