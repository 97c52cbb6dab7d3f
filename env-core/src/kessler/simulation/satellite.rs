//! State of one satellite.

use crate::kessler::constants::SURVIVAL_THRESHOLD;
use crate::kessler::kernel::Body;

/// Status of a satellite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SatelliteStatus {
    /// The satellite flies and takes burns.
    Active,
    /// The satellite was hit or fell into the Earth.
    Lost,
}

/// One satellite of an episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Satellite {
    /// State vector of the satellite.
    pub body: Body,
    /// Remaining fuel, in fuel units.
    pub fuel: f64,
    /// Status of the satellite.
    pub status: SatelliteStatus,
    /// Probability that the satellite still flies: 1 or 0, or under `risk: pc` the product of 1 − Pc over its
    /// close approaches.
    pub survival: f64,
}

impl Satellite {
    /// Returns true if the satellite flies.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.status == SatelliteStatus::Active
    }

    /// Returns true if the satellite counts as lost: not active, or survival below [`SURVIVAL_THRESHOLD`].
    #[must_use]
    pub fn is_lost(&self) -> bool {
        !self.is_active() || self.survival < SURVIVAL_THRESHOLD
    }

    /// Marks the satellite as lost.
    pub(super) fn lose(&mut self) {
        self.status = SatelliteStatus::Lost;
        self.survival = 0.0;
    }
}
