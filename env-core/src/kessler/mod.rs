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
mod scene;
pub mod setup;
pub mod spaces;
pub mod telemetry;
#[cfg(test)]
mod tests;
pub mod tracks;
pub mod warnings;
mod wire;
mod world;

use std::any::Any;
use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::Value;

pub use self::cloud::least_distances;
pub use self::world::KESSLER;

use self::constants::{EPSILON, GOAL, HORIZON, MAX_BURN, SATELLITES};
use self::episode::KesslerEpisode;
use self::reward::Objective;
use self::setup::Setup;
use crate::batch::{Batch, BatchConfig, BatchError, Feed};
use crate::bracket::{Bracket, Flown};
use crate::critique::{Critique, Judged, ModeSpec, SpeedBands};
use crate::error::{LogError, ScenarioError};
use crate::log::ActionLog;
use crate::policy::{Policy, PolicyError, PolicySpec};
use crate::reflex::Reflex;
use crate::rollout::ReplayError;
use crate::scenario::{Recipe, Scenario};
use crate::space::{ActionSpace, Choices, Levels, ParamSpec, ScoreRange};
use crate::task::{Episode, TaskCard, TaskSpec};
use crate::wire::Wire;

/// The world and its version.
pub const WORLD: &str = "kessler@1";
/// Skill from which an episode with nobody lost is a success (survival, eco_station).
pub const SKILLED: f64 = 0.8;

/// A task of kessler.
#[derive(Debug)]
pub struct Kessler {
    card: TaskCard,
    objective: Objective,
}

const fn card(
    id: &'static str,
    about: &'static str,
    params: &'static [ParamSpec],
    levels: &'static LazyLock<Levels>,
) -> TaskCard {
    TaskCard { id, world: WORLD, about, params, options: &spaces::OPTIONS, levels }
}

/// The tasks.
pub static TASKS: [Kessler; 4] = [
    Kessler {
        card: card(
            "kessler/survival",
            "Keep three satellites alive for 50 steps.",
            &spaces::SURVIVAL_SPACE,
            &spaces::SURVIVAL_LEVELS,
        ),
        objective: Objective::Survival,
    },
    Kessler {
        card: card(
            "kessler/eco_station",
            "Keep three satellites alive and their fuel unspent.",
            &spaces::ECO_STATION_SPACE,
            &spaces::ECO_STATION_LEVELS,
        ),
        objective: Objective::EcoStation,
    },
    Kessler {
        card: card(
            "kessler/rendezvous",
            "Bring satellite 0 to radius 100 LU and hold it there, losing nobody.",
            &spaces::RENDEZVOUS_SPACE,
            &spaces::RENDEZVOUS_LEVELS,
        ),
        objective: Objective::Rendezvous,
    },
    Kessler {
        card: card(
            "kessler/formation",
            "Keep three satellites in a triangle of side 20 LU, losing nobody.",
            &spaces::FORMATION_SPACE,
            &spaces::FORMATION_LEVELS,
        ),
        objective: Objective::Formation,
    },
];

/// What a task of this world rewards, by its id.
fn objective(id: &str) -> Option<Objective> {
    TASKS.iter().find(|task| task.card.id == id).map(|task| task.objective)
}

impl Kessler {
    /// What the task rewards.
    #[must_use]
    pub const fn objective(&self) -> Objective {
        self.objective
    }
}

impl TaskSpec for Kessler {
    fn card(&self) -> &TaskCard {
        &self.card
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

    fn agent_axes(&self) -> Option<&'static [&'static str]> {
        Some(&["radial", "in_track"])
    }

    fn choices(&self) -> Choices {
        spaces::choices()
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
        planner::bracket(self.objective, scenario, &|| true)
    }

    fn bracket_while(
        &self,
        scenario: &Scenario,
        wanted: &dyn Fn() -> bool,
    ) -> Result<Option<Bracket>, ScenarioError> {
        let bracket = planner::bracket(self.objective, scenario, wanted)?;
        Ok(wanted().then_some(bracket))
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

    fn wire(&self) -> &'static dyn Wire {
        &wire::KesslerWire
    }

    fn read_observation(&self, wire: &Value) -> serde_json::Result<Box<dyn Any + Send>> {
        Ok(Box::new(telemetry::Telemetry::deserialize(wire)?))
    }

    fn batch(&self, feed: Box<dyn Feed>, config: BatchConfig) -> Result<Box<dyn Batch>, BatchError> {
        batch::batch(self.objective, self.card.id, feed, config)
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

    fn judge_step(&self, scenario: &Scenario, log: &ActionLog) -> Result<Option<Judged>, ReplayError> {
        critique::judge_step(self.objective, scenario, log).map(Some)
    }

    fn policy(&self, name: &str, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError> {
        policies::by_name(name, self.objective, scenario, seed)
    }
}
