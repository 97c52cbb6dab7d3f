//! `docking`: one to five deputies dock with a chief on a circular orbit, by Clohessy–Wiltshire dynamics, in SI units and
//! Hill's frame. Rewards, ends and observations are per agent, and those of safe-autonomy-sims' multi-agent docking to
//! the number. `docs/docking.md` has the tables.

pub mod approach;
mod batch;
mod codec;
pub mod constants;
mod critique;
pub mod deputy;
mod episode;
pub mod event;
pub mod flight;
pub mod planner;
pub mod policies;
pub mod record;
pub mod relative;
pub mod reward;
mod scene;
pub mod setup;
pub mod spaces;
pub mod telemetry;
#[cfg(test)]
mod tests;
mod wire;
mod world;

use std::any::Any;
use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::Value;

pub use self::world::DOCKING;

use self::constants::MAX_THRUST_N;
use self::episode::DockingEpisode;
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
use crate::space::{ActionSpace, Choices, Levels, ParamSpec, ScoreRange};
use crate::task::{Episode, TaskCard, TaskSpec};
use crate::wire::Wire;

/// The world and its version.
pub const WORLD: &str = "docking@1";

/// What a return, and so the mean of returns, lies within.
///
/// Coming nearer adds up to 2(e^{−a d_T} − e^{−a d_1}), within ±2. Thrust costs at most 0.01 · 3 N/12 kg in each of at
/// most 2000 s: 5. The velocity reward ends a deputy at −5, which its last step can overshoot by 0.01 + 0.01·(v − limit):
/// within bounds the limit is below 20.8 m/s and speed grows by less than √3/12 + 3n²·10⁴ + n²·10⁴ < 0.19 m/s², so that
/// getting to v costs 0.01·(v − 20.8)²/(2·0.19) on the way, which ends it before 35 m/s; layouts start below 17.4 m/s.
/// So the overshoot is below 0.4. Docking pays 2 at most, failing costs 1 once.
const SCORE_RANGE: ScoreRange = ScoreRange { min: -2.0 - 5.0 - 5.4 - 1.0, max: 2.0 + 2.0 };

/// A task of docking.
#[derive(Debug)]
pub struct Docking {
    card: TaskCard,
}

const fn card(
    id: &'static str,
    about: &'static str,
    params: &'static [ParamSpec],
    levels: &'static LazyLock<Levels>,
) -> TaskCard {
    TaskCard { id, world: WORLD, about, params, options: &[], levels }
}

/// The tasks.
pub static TASKS: [Docking; 2] = [
    Docking {
        card: card(
            "docking/single",
            "Dock one deputy with the chief, gently and in time.",
            &spaces::SINGLE_SPACE,
            &spaces::SINGLE_LEVELS,
        ),
    },
    Docking {
        card: card(
            "docking/multiagent",
            "Dock every deputy with the chief, gently and in time, without touching each other.",
            &spaces::MULTIAGENT_SPACE,
            &spaces::MULTIAGENT_LEVELS,
        ),
    },
];

impl TaskSpec for Docking {
    fn card(&self) -> &TaskCard {
        &self.card
    }

    fn horizon(&self, recipe: &Recipe) -> u32 {
        recipe.param("time_limit_s").map_or(0, |limit| limit as u32)
    }

    fn agents(&self, recipe: &Recipe) -> u32 {
        recipe.param("deputies").map_or(1, |deputies| deputies as u32)
    }

    fn action_space(&self) -> ActionSpace {
        ActionSpace { columns: &["fx", "fy", "fz"], low: -MAX_THRUST_N, high: MAX_THRUST_N, unit: "N" }
    }

    fn choices(&self) -> Choices {
        spaces::choices()
    }

    fn score_range(&self) -> ScoreRange {
        SCORE_RANGE
    }

    fn check(&self, recipe: &Recipe) -> Result<(), ScenarioError> {
        Setup::read(recipe).map(|_| ())
    }

    fn start(&self, scenario: &Scenario) -> Result<Box<dyn Episode>, ScenarioError> {
        Ok(Box::new(DockingEpisode::start(scenario)?))
    }

    fn bracket(&self, scenario: &Scenario) -> Result<Bracket, ScenarioError> {
        planner::bracket(scenario)
    }

    /// None: a scenario of docking is contested whenever the reference succeeds.
    fn plant_contested(&self, _: &Scenario) -> Option<(Scenario, Bracket)> {
        None
    }

    fn success(&self, flown: &Flown, _: Option<f64>) -> bool {
        flown.lost == 0 && flown.goal.is_some_and(|docked| docked >= 1.0)
    }

    fn blind_can_succeed(&self) -> bool {
        false
    }

    fn read_step(&self, step: &Value, log: &mut ActionLog) -> Result<(), LogError> {
        codec::read_step(step, log)
    }

    fn wire(&self) -> &'static dyn Wire {
        &wire::DockingWire
    }

    fn read_observation(&self, wire: &Value) -> serde_json::Result<Box<dyn Any + Send>> {
        Ok(Box::new(telemetry::Telemetry::deserialize(wire)?))
    }

    fn batch(&self, feed: Box<dyn Feed>, config: BatchConfig) -> Result<Box<dyn Batch>, BatchError> {
        batch::batch(self, feed, config)
    }

    fn policies(&self) -> &'static [PolicySpec] {
        &policies::SPECS
    }

    fn reflex(&self) -> Reflex {
        policies::reflex::REFLEX
    }

    fn failure_modes(&self) -> &'static [ModeSpec] {
        &critique::MODES
    }

    fn speed_bands(&self) -> SpeedBands {
        critique::SPEED_BANDS
    }

    fn critique(&self, scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError> {
        critique::critique(scenario, log)
    }

    fn policy(&self, name: &str, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError> {
        policies::by_name(name, scenario, seed)
    }
}
