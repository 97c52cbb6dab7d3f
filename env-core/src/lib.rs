//! The worlds that Sparring trains agents in.
//!
//! The crate is pure: no I/O, no async, no clock, no ambient randomness. `(scenario, actions)` determines every bit of an
//! episode on any IEEE-754 platform. Therefore dynamics use only `+ − × ÷ √`, transcendental functions come from the `libm`
//! crate, and every random draw goes through [`episode_rng::EpisodeRng`].
//!
//! - A *world* ([`world::World`]) is a module of tasks: [`kessler`] and [`docking`].
//! - A *task* ([`task::TaskSpec`]) defines scenarios, episodes, policies and critiques. Nothing outside a world's module knows
//!   the columns of its bodies: callers use parameter spaces, levels and outcomes as data.
//! - [`registry`] lists all worlds and is above them.
//! - [`frames`] shows an episode step by step as JSON.
//! - [`rollout`] runs single episodes, [`batch`] steps many environments, [`admission`] judges scenarios by their bracket.
//!
//! The OpenEnv protocol of tasks is in the crate `openenv-wire`. Start reading at [`mod@task`].

pub mod admission;
pub mod batch;
pub mod bracket;
mod canonical;
pub mod critique;
mod difference_tally;
pub mod docking;
pub mod episode_rng;
pub mod error;
pub mod frames;
mod json_fields;
mod json_writer;
pub mod kessler;
pub mod keyed_rng;
pub mod log;
mod number_format;
pub mod policy;
pub mod policy_factory;
pub mod reflex;
pub mod registry;
pub mod rollout;
mod scenario_parser;
pub mod scene;
pub mod seed;
pub mod space;
pub mod task;
pub mod tasking;
#[cfg(test)]
mod testing;
pub mod text;
pub mod world;

pub use admission::{Admission, SuccessRule};
pub use bracket::{Bracket, EpisodeOutcome};
pub use critique::Critique;
pub use error::{LogError, ReplayError, ScenarioError, StepError};
pub use keyed_rng::KeyedRng;
pub use log::{ActionLog, JointAction, StopReason};
pub use number_format::{format_shortest, format_significant};
pub use registry::{benchmark, default_tasks, task, tasks, world, worlds};
pub use rollout::Rollout;
pub use seed::{MAX_USER_SEED, SEED_REQUIREMENT, Seed, SeedSpace};
pub use task::{Episode, Layout, Recipe, RecipeId, Scenario, ScenarioId, TaskSpec};
pub use world::World;
