//! `kessler`: three satellites, debris and the Earth in a plane, in canonical units (length LU, time TU). The wire names
//! are those of the public kessler-env; where that is wrong this world is right, and `compat: upstream` restores its
//! arithmetic. `docs/kessler.md` has the tables.

pub mod batch;
pub mod bearing;
mod cloud;
mod codec;
mod columns;
pub mod constants;
mod critique;
pub mod debris;
mod episode;
pub mod event;
pub mod flight;
mod forecast;
pub mod kernel;
mod pass;
pub mod planner;
pub mod plant;
pub mod policies;
pub mod record;
pub mod reward;
mod scatter;
pub mod setup;
pub mod spaces;
pub mod telemetry;
#[cfg(test)]
mod tests;
pub mod tracks;
pub mod warnings;
mod world;

use serde_json::Value;

pub use self::world::KESSLER;

use self::constants::{EPSILON, GOAL, HORIZON, MAX_BURN, SATELLITES};
use self::episode::KesslerEpisode;
use self::reward::Objective;
use self::setup::Setup;
use crate::batch::{Batch, BatchConfig, BatchError, Feed};
use crate::bracket::{Bracket, Flown};
use crate::critique::{Critique, ModeSpec, SpeedBands};
use crate::error::{LogError, ScenarioError};
use crate::log::ActionLog;
use crate::policy::{Policy, PolicyError, PolicySpec};
use crate::reflex::Reflex;
use crate::rollout::ReplayError;
use crate::scenario::{Recipe, Scenario};
use crate::space::{ActionSpace, Levels, OptionSpec, ParamSpec, ScoreRange};
use crate::task::{Episode, TaskSpec};

/// The world and its version.
pub const WORLD: &str = "kessler@1";
/// Skill from which an episode with nobody lost is a success (survival, eco_station).
pub const SKILLED: f64 = 0.8;

/// A task of kessler.
#[derive(Debug)]
pub struct Kessler {
    id: &'static str,
    about: &'static str,
    objective: Objective,
    space: &'static [ParamSpec],
    levels: &'static std::sync::LazyLock<Levels>,
}

/// The tasks.
pub static TASKS: [Kessler; 4] = [
    Kessler {
        id: "kessler/survival",
        about: "Keep three satellites alive for 50 steps.",
        objective: Objective::Survival,
        space: &spaces::SURVIVAL_SPACE,
        levels: &spaces::SURVIVAL_LEVELS,
    },
    Kessler {
        id: "kessler/eco_station",
        about: "Keep three satellites alive and their fuel unspent.",
        objective: Objective::EcoStation,
        space: &spaces::ECO_STATION_SPACE,
        levels: &spaces::ECO_STATION_LEVELS,
    },
    Kessler {
        id: "kessler/rendezvous",
        about: "Bring satellite 0 to radius 100 LU and hold it there, losing nobody.",
        objective: Objective::Rendezvous,
        space: &spaces::RENDEZVOUS_SPACE,
        levels: &spaces::RENDEZVOUS_LEVELS,
    },
    Kessler {
        id: "kessler/formation",
        about: "Keep three satellites in a triangle of side 20 LU, losing nobody.",
        objective: Objective::Formation,
        space: &spaces::FORMATION_SPACE,
        levels: &spaces::FORMATION_LEVELS,
    },
];

/// What a task of this world rewards, by its id.
fn objective(id: &str) -> Option<Objective> {
    TASKS.iter().find(|task| task.id == id).map(|task| task.objective)
}

impl Kessler {
    /// What the task rewards.
    #[must_use]
    pub const fn objective(&self) -> Objective {
        self.objective
    }
}

impl TaskSpec for Kessler {
    fn id(&self) -> &'static str {
        self.id
    }

    fn world(&self) -> &'static str {
        WORLD
    }

    fn about(&self) -> &'static str {
        self.about
    }

    fn params(&self) -> &'static [ParamSpec] {
        self.space
    }

    fn options(&self) -> &'static [OptionSpec] {
        &spaces::OPTIONS
    }

    fn levels(&self) -> &'static Levels {
        self.levels
    }

    fn horizon(&self, _: &Recipe) -> u32 {
        HORIZON
    }

    fn agents(&self, _: &Recipe) -> u32 {
        SATELLITES as u32
    }

    fn action_space(&self) -> ActionSpace {
        ActionSpace { columns: &["delta_vx", "delta_vy"], low: -MAX_BURN, high: MAX_BURN, unit: "LU/TU" }
    }

    fn score_range(&self) -> ScoreRange {
        ScoreRange { min: EPSILON, max: 1.0 - EPSILON }
    }

    fn check(&self, recipe: &Recipe) -> Result<(), ScenarioError> {
        Setup::read(recipe).map(|_| ())
    }

    fn start(&self, scenario: &Scenario) -> Result<Box<dyn Episode>, ScenarioError> {
        Ok(Box::new(KesslerEpisode::start(self.objective, scenario)?))
    }

    fn bracket(&self, scenario: &Scenario) -> Result<Bracket, ScenarioError> {
        planner::bracket(self.objective, scenario)
    }

    fn plant_contested(&self, scenario: &Scenario) -> Option<(Scenario, Bracket)> {
        plant::plant_contested(scenario)
    }

    fn success(&self, flown: &Flown, skill: Option<f64>) -> bool {
        flown.lost == 0
            && match self.objective {
                Objective::Survival | Objective::EcoStation => skill.is_none_or(|s| s >= SKILLED),
                Objective::Rendezvous | Objective::Formation => flown.goal.is_some_and(|g| g >= GOAL),
            }
    }

    fn blind_can_succeed(&self) -> bool {
        matches!(self.objective, Objective::Survival | Objective::EcoStation)
    }

    fn read_step(&self, step: &Value, log: &mut ActionLog) -> Result<(), LogError> {
        codec::read_step(step, log)
    }

    fn batch(&self, feed: Box<dyn Feed>, config: BatchConfig) -> Result<Box<dyn Batch>, BatchError> {
        batch::batch(self.objective, self.id, feed, config)
    }

    fn policies(&self) -> &'static [PolicySpec] {
        &policies::SPECS
    }

    fn reflex(&self) -> Reflex {
        policies::learner::REFLEX
    }

    fn failure_modes(&self) -> &'static [ModeSpec] {
        critique::modes(self.objective)
    }

    fn speed_bands(&self) -> SpeedBands {
        critique::SPEED_BANDS
    }

    fn critique(&self, scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError> {
        critique::critique(self.objective, scenario, log)
    }

    fn policy(&self, name: &str, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError> {
        policies::by_name(name, self.objective, scenario, seed)
    }
}
