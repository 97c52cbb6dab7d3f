//! A satellite in flight.

use crate::kessler::constants::SURVIVED;
use crate::kessler::kernel::Body;

/// What became of a satellite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// It flies.
    Active,
    /// It was hit, or fell into the Earth.
    Lost,
}

/// One satellite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Satellite {
    /// Where it is and how it moves.
    pub body: Body,
    /// Fuel left.
    pub fuel: f64,
    /// Whether it flies.
    pub status: Status,
    /// Probability that it still flies: 1 or 0, or under `risk: pc` the product over its encounters of 1 − Pc.
    pub survival: f64,
}

impl Satellite {
    /// Whether it flies.
    #[must_use]
    pub fn active(&self) -> bool {
        self.status == Status::Active
    }

    /// Whether it counts as lost.
    #[must_use]
    pub fn lost(&self) -> bool {
        !self.active() || self.survival < SURVIVED
    }

    pub(super) fn lose(&mut self) {
        self.status = Status::Lost;
        self.survival = 0.0;
    }
}
