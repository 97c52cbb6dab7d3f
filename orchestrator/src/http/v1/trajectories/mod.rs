//! Trajectory feed of a run: groups that the server ran, pulled and acknowledged by a trainer.

pub(super) mod acknowledge;
pub(super) mod pull;
mod response;
