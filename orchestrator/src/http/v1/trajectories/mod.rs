//! Trajectory feed of a run: groups that the server ran. A trainer claims and acknowledges them, or reads them without a claim.

pub(super) mod acknowledge;
pub(super) mod claim;
pub(super) mod read;
mod response;
mod wait;
