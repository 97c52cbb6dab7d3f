//! The world `tasking`: Earth-observation satellites that execute tasks, as BSK-RL 1.3.8 on Basilisk 2.12.1 simulates them.
//!
//! The world computes Basilisk's closed loop at 1 Hz; it does not approximate it. Recorded episodes of BSK-RL are replayed by the
//! tests `validate_bsk_*`. Start reading at [`simulation`] for an episode, at [`tick`] for one tick, and at [`orbit`] for the
//! sky.

pub mod access;
pub mod clock;
pub mod constants;
pub mod earth;
pub mod environments;
pub mod error;
pub mod observation;
pub mod orbit;
pub mod pack;
pub mod real;
pub mod recording;
pub mod satellite;
pub mod setup;
pub mod simulation;
pub mod sun;
mod sun_correction;
pub mod task;
#[cfg(test)]
mod tests;
pub mod tick;
pub mod time;
pub mod vector3;
mod world;

pub use self::world::TASKING;

/// Id of the world with its version.
pub const WORLD_ID: &str = "tasking@1";
