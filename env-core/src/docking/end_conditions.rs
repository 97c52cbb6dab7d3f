//! The rules by which a deputy leaves an episode.

use serde::{Deserialize, Serialize};

/// State of a deputy: active, or how it left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeputyStatus {
    /// It is still in the episode.
    Active,
    /// It docked with the chief.
    Docked,
    /// It came within the docking radius above the speed limit.
    Crashed,
    /// It flew out of bounds.
    OutOfBounds,
    /// It violated the speed limit until its penalty reached the minimum.
    Saturated,
    /// Two deputies collided: it was one of them, or was active when that ended the episode.
    Collided,
    /// The time limit was reached.
    TimedOut,
}

/// All rules by which a deputy left in a step; several can hold at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EndConditions {
    /// True if the time limit was reached.
    pub timeout: bool,
    /// True if the deputy flew out of bounds.
    pub out_of_bounds: bool,
    /// True if the deputy came within the docking radius above the speed limit.
    pub crash: bool,
    /// True if the deputy docked.
    pub docked: bool,
    /// True if the velocity penalty reached its minimum.
    pub saturated: bool,
    /// True if deputies collided.
    pub collision: bool,
}

impl EndConditions {
    /// True if any condition holds.
    #[must_use]
    pub const fn any(self) -> bool {
        self.timeout || self.out_of_bounds || self.crash || self.docked || self.saturated || self.collision
    }

    /// The condition that decides the deputy's status. Docking takes precedence over all others.
    #[must_use]
    pub const fn status(self) -> DeputyStatus {
        match self {
            Self { docked: true, .. } => DeputyStatus::Docked,
            Self { crash: true, .. } => DeputyStatus::Crashed,
            Self { out_of_bounds: true, .. } => DeputyStatus::OutOfBounds,
            Self { saturated: true, .. } => DeputyStatus::Saturated,
            Self { collision: true, .. } => DeputyStatus::Collided,
            Self { timeout: true, .. } => DeputyStatus::TimedOut,
            _ => DeputyStatus::Active,
        }
    }
}
