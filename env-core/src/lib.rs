//! The worlds Sparring trains in.
//!
//! Pure: no I/O, no async, no clock, no ambient randomness. `(scenario, actions)` decides every bit of an episode, on
//! any IEEE-754 platform. Therefore the dynamics use only `+ − × ÷ √`, transcendental functions come from the `libm`
//! crate, and every random draw goes through [`chance::Chance`].
//!
//! A *task* is one [`task::TaskSpec`]; a *world* is a module of them ([`kessler`], [`docking`]). Nothing outside a
//! world's own module knows its columns: the service reads parameter spaces, levels and outcomes as data.

pub mod batch;
pub mod bracket;
mod canonical;
pub mod chance;
pub mod critique;
pub mod docking;
pub mod draws;
pub mod error;
pub mod kessler;
pub mod log;
pub mod policy;
pub mod reflex;
pub mod registry;
pub mod rollout;
pub mod scenario;
pub mod scene;
pub mod seed;
pub mod space;
pub mod task;
#[cfg(test)]
mod testing;
mod told;
pub mod wire;
pub mod world;

pub use bracket::{Admission, Bracket, Flown, SuccessRule};
pub use critique::Critique;
pub use draws::Draws;
pub use error::{LogError, ScenarioError, StepError};
pub use log::{ActionLog, JointAction, Stopped};
pub use registry::{task, tasks, usual_tasks, world, worlds};
pub use scenario::{Layout, Recipe, RecipeId, Scenario, ScenarioId};
pub use seed::{FREE_MASK, SEED_WANTED, Seed, SeedSpace};
pub use task::{Episode, TaskSpec};
pub use told::{significant, told};
pub use wire::{Place, Wire, WireFault};
pub use world::World;
