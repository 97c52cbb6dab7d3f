//! Blind panel: 16 plans that do not depend on debris.

use super::ephemeris::DebrisEphemeris;
use super::trajectory::Trajectory;
use crate::kessler::constants::FUEL_PER_SPEED;
use crate::kessler::kernel::Body;

/// Number of plans of the panel.
pub const PANEL_SIZE: usize = 16;
/// Sizes of the kicks, LU/TU, each in four directions; the last in three.
const KICK_SIZES: [f64; 4] = [0.05, 0.1, 0.2, 0.4];
/// Factor that keeps a kick of all fuel from being rejected by one rounding.
const WITHIN_FUEL: f64 = 1.0 - 1e-12;

/// Direction of a kick in a satellite's own axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KickDirection {
    /// Along the motion of a prograde orbit.
    Prograde,
    /// Away from the Earth's centre.
    RadialOut,
    /// Against the motion of a prograde orbit.
    Retrograde,
    /// Towards the Earth's centre.
    RadialIn,
}

const KICK_DIRECTIONS: [KickDirection; 4] =
    [KickDirection::Prograde, KickDirection::RadialOut, KickDirection::Retrograde, KickDirection::RadialIn];

impl KickDirection {
    /// Unit vector of the direction for this body.
    #[must_use]
    pub fn unit_vector(self, body: &Body) -> (f64, f64) {
        let ((rx, ry), (tx, ty)) = body.local_axes();
        match self {
            Self::Prograde => (tx, ty),
            Self::RadialOut => (rx, ry),
            Self::Retrograde => (-tx, -ty),
            Self::RadialIn => (-rx, -ry),
        }
    }
}

/// Largest kick up to `size` that `fuel` allows, LU/TU.
#[must_use]
pub fn affordable_size(size: f64, fuel: f64) -> f64 {
    size.min(fuel / FUEL_PER_SPEED * WITHIN_FUEL)
}

/// Plan `index` of the panel for one satellite: `None` for hold, else the kick (dvx, dvy) of the first step,
/// LU/TU.
#[must_use]
pub fn panel_kick(index: usize, body: &Body, fuel: f64) -> Option<(f64, f64)> {
    let kick = index.checked_sub(1)?;
    let (dx, dy) = KICK_DIRECTIONS[kick % 4].unit_vector(body);
    let size = affordable_size(KICK_SIZES[kick / 4], fuel);
    Some((size * dx, size * dy))
}

/// Trajectories of one satellite under each plan of the panel; the first is hold.
pub(super) fn panel_trajectories(ephemeris: &DebrisEphemeris, body: Body, fuel: f64) -> Vec<Trajectory> {
    (0..PANEL_SIZE)
        .map(|index| {
            let mut trajectory = Trajectory::new(body, fuel);
            if trajectory.advance(ephemeris, 1, panel_kick(index, &body, fuel)) {
                trajectory.propagate_from(ephemeris, 2, &[]);
            }
            trajectory
        })
        .collect()
}
