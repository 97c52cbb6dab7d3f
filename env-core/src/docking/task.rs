//! The tasks of docking.

use std::any::Any;
use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::Value;

use super::constants::MAX_THRUST_N;
use super::episode::DockingEpisode;
use super::setup::DockingSetup;
use super::{WORLD_ID, batch, codec, critique, planner, policies, spaces, telemetry};
use crate::batch::{Batch, BatchConfig, BatchError, ScenarioSource};
use crate::bracket::{Bracket, EpisodeOutcome};
use crate::critique::{Critique, FailureModeSpec, SectorQuantity, SpeedBands};
use crate::error::ReplayError;
use crate::error::{LogError, ScenarioError};
use crate::log::ActionLog;
use crate::policy::{Policy, PolicyError, PolicySpec};
use crate::reflex::Reflex;
use crate::space::{ActionGrid, ActionSpace, Levels, ParamSpec, ScoreRange};
use crate::task::{Episode, TaskMetadata, TaskSpec};
use crate::task::{Recipe, Scenario};

/// Bounds of a return, and so of the mean of returns.
///
/// Rewards for approaching sum up to 2(e^{−a d_T} − e^{−a d_1}), within ±2. Thrust costs at most 0.01 · 3 N/12 kg in each of at
/// most 2000 s: 5. A deputy is stopped at a velocity penalty of −5, which its last step can exceed by 0.01 +
/// 0.01·(v − limit). Within bounds the limit is below 20.8 m/s and speed grows by less than √3/12 + 3n²·10⁴ + n²·10⁴ <
/// 0.19 m/s². Reaching v therefore costs 0.01·(v − 20.8)²/(2·0.19) on the way, which stops the deputy before 35 m/s;
/// layouts start below 17.4 m/s. So the excess is below 0.4. Docking pays at most 2, failing costs 1 once.
const DOCKING_SCORE_RANGE: ScoreRange = ScoreRange { min: -2.0 - 5.0 - 5.4 - 1.0, max: 2.0 + 2.0 };

/// A task of docking.
#[derive(Debug)]
pub struct DockingTask {
    card: TaskMetadata,
}

const fn card(
    id: &'static str,
    description: &'static str,
    params: &'static [ParamSpec],
    levels: &'static LazyLock<Levels>,
) -> TaskMetadata {
    TaskMetadata {
        id,
        world: WORLD_ID,
        description,
        params,
        options: &[],
        levels,
        start_rungs: &spaces::START_RUNGS,
    }
}

/// The tasks of docking.
pub static DOCKING_TASKS: [DockingTask; 2] = [
    DockingTask {
        card: card(
            "docking/single",
            "Dock one deputy with the chief, gently and in time.",
            &spaces::SINGLE_SPACE,
            &spaces::SINGLE_LEVELS,
        ),
    },
    DockingTask {
        card: card(
            "docking/multiagent",
            "Dock every deputy with the chief, gently and in time, without touching each other.",
            &spaces::MULTIAGENT_SPACE,
            &spaces::MULTIAGENT_LEVELS,
        ),
    },
];

impl TaskSpec for DockingTask {
    fn metadata(&self) -> &TaskMetadata {
        &self.card
    }

    fn horizon(&self, recipe: &Recipe) -> u32 {
        recipe.param("time_limit_s").map_or(0, |limit| limit as u32)
    }

    fn time_limit_s(&self, recipe: &Recipe) -> Option<f64> {
        recipe.param("time_limit_s")
    }

    fn agents(&self, recipe: &Recipe) -> u32 {
        recipe.param("deputies").map_or(1, |deputies| deputies as u32)
    }

    fn action_space(&self) -> ActionSpace {
        ActionSpace::new_box(&["fx", "fy", "fz"], -MAX_THRUST_N, MAX_THRUST_N, "N")
    }

    fn action_grid(&self) -> ActionGrid {
        spaces::choices()
    }

    fn few_actions(&self) -> ActionGrid {
        spaces::few_actions()
    }

    fn score_range(&self) -> ScoreRange {
        DOCKING_SCORE_RANGE
    }

    fn check(&self, recipe: &Recipe) -> Result<(), ScenarioError> {
        DockingSetup::read(recipe).map(|_| ())
    }

    fn start(&self, scenario: &Scenario) -> Result<Box<dyn Episode>, ScenarioError> {
        Ok(Box::new(DockingEpisode::start(scenario)?))
    }

    fn bracket(&self, scenario: &Scenario) -> Result<Bracket, ScenarioError> {
        planner::bracket(scenario)
    }

    /// Always `None`: a scenario of docking is contested whenever the reference succeeds.
    fn make_contested(&self, _: &Scenario) -> Option<(Scenario, Bracket)> {
        None
    }

    fn is_success(&self, outcome: &EpisodeOutcome, _: Option<f64>) -> bool {
        outcome.lost == 0 && outcome.goal.is_some_and(|docked| docked >= 1.0)
    }

    fn blind_can_succeed(&self) -> bool {
        false
    }

    fn read_step(&self, step: &Value, log: &mut ActionLog) -> Result<(), LogError> {
        codec::THRUST_FORMAT.read_entries(step, log)
    }

    fn read_observation(&self, value: &Value) -> serde_json::Result<Box<dyn Any + Send>> {
        Ok(Box::new(telemetry::DockingTelemetry::deserialize(value)?))
    }

    fn batch(
        &self,
        source: Box<dyn ScenarioSource>,
        config: BatchConfig,
    ) -> Result<Box<dyn Batch>, BatchError> {
        batch::create_batch(self, source, config)
    }

    fn policies(&self) -> &'static [PolicySpec] {
        &policies::DOCKING_POLICIES
    }

    fn reflex(&self) -> Reflex {
        policies::reflex::DOCKING_REFLEX
    }

    fn failure_modes(&self) -> &'static [FailureModeSpec] {
        &critique::DOCKING_FAILURE_MODES
    }

    fn speed_bands(&self) -> SpeedBands {
        critique::DOCKING_SPEED_BANDS
    }

    fn sector_quantity(&self) -> SectorQuantity {
        SectorQuantity::BEARING
    }

    fn critique(&self, scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError> {
        critique::critique(scenario, log)
    }

    fn policy(&self, name: &str, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError> {
        policies::create_policy(name, scenario, seed)
    }
}
