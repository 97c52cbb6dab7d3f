//! World `kessler`: three satellites, debris and the Earth in a plane, in canonical units (length LU, time
//! TU). Names in JSON are those of the public kessler-env. Where that environment is wrong, this world is
//! right, and `compat: upstream` restores its arithmetic. `docs/worlds/kessler.md` has the tables.
//!
//! Start reading at `task` (the four tasks) and [`simulation`] (the engine). Below the engine are [`kernel`]
//! (motion and burns), `propagate` and [`debris`] (all debris at once, vectorised), [`setup`] (recipes and
//! initial states) and [`reward`]. Above it are the observations (`columns`, [`tracks`], [`telemetry`],
//! [`warnings`]), the reference [`planner`], the built-in [`policies`] and the `critique`. The batch engine,
//! recipes and the traits of tasks and worlds live in the crate's root.

pub mod batch;
pub mod bearing;
mod body_blocks;
mod codec;
mod column_writer;
mod columns;
pub mod constants;
mod critique;
pub mod debris;
mod debris_init;
mod episode;
pub mod event;
mod forecast;
pub mod kernel;
mod observation;
pub mod planner;
pub mod policies;
mod propagate;
pub mod recording;
pub mod reward;
mod scene;
pub mod setup;
pub mod simulation;
pub mod spaces;
mod task;
pub mod telemetry;
#[cfg(test)]
mod tests;
pub mod threat_placement;
pub mod tracks;
pub mod warnings;
mod world;

pub use self::propagate::min_distances;
pub use self::task::{KESSLER_TASKS, KesslerTask, MIN_SUCCESS_SKILL};
pub use self::world::KESSLER;

/// Id of the world: its name and version.
pub const WORLD_ID: &str = "kessler@1";
