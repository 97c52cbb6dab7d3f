//! The world `docking`: one to five deputies dock with a chief on a circular orbit, by Clohessy–Wiltshire dynamics, in SI
//! units and Hill's frame.
//!
//! Rewards, end conditions and observations are per agent and equal those of safe-autonomy-sims' multi-agent docking.
//! `docs/worlds/docking.md` has the tables. Start reading at [`simulation`] for the rules of a step, and at [`DockingTask`] for how
//! the world is used. Everything that more than one world needs is in the parent module.

pub mod approach_law;
mod batch;
mod codec;
pub mod constants;
mod critique;
pub mod deputy;
pub mod end_conditions;
mod episode;
pub mod event;
mod observation;
pub mod planner;
pub mod policies;
pub mod recording;
pub mod relative_motion;
pub mod reward;
mod scene;
pub mod setup;
pub mod simulation;
pub mod spaces;
mod task;
pub mod telemetry;
#[cfg(test)]
mod tests;
mod world;

pub use self::task::{DOCKING_TASKS, DockingTask};
pub use self::world::DOCKING;

/// Id of the world with its version.
pub const WORLD_ID: &str = "docking@1";
