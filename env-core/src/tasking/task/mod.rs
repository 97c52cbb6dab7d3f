//! The tasks of the world: scenarios with params and levels, scores, policies and brackets.
//!
//! Start reading at [`TaskingTask`] for how a task is used, and at [`run`] for the rules of an episode.

mod blind;
mod bracket;
pub mod coastline;
mod codec;
mod critique;
mod drawn_start;
mod episode;
pub mod forecast;
mod lane;
pub mod layout;
pub mod map;
pub mod motion;
mod planner;
mod policies;
mod replay;
mod rounding;
mod rule;
mod run;
mod scene;
mod spaces;
mod task_setup;
pub mod telemetry;
#[cfg(test)]
mod tests;

use std::any::Any;
use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::Value;

use self::episode::TaskingEpisode;
pub use self::spaces::{IMAGE_ACTIONS, IMAGING_ACTION_NAMES, MAX_SATELLITES, SCANNING_ACTION_NAMES};
use self::task_setup::TaskSetup;
use super::WORLD_ID;
use crate::batch::{Batch, BatchConfig, BatchError, ScenarioSource};
use crate::bracket::{Bracket, EpisodeOutcome};
use crate::critique::{Critique, FailureModeSpec, SectorQuantity, SpeedBands};
use crate::error::{LogError, ReplayError, ScenarioError};
use crate::log::ActionLog;
use crate::policy::{Policy, PolicyError, PolicySpec};
use crate::reflex::Reflex;
use crate::rollout::ReplayItem;
use crate::space::{ActionGrid, ActionSpace, Axes, Levels, OptionSpec, ParamSpec, ScoreRange};
use crate::task::{Episode, Recipe, Scenario, TaskMetadata, TaskSpec};

/// Skill from which an episode without a death is a success.
const SUCCESS_SKILL: f64 = 0.8;

/// A task of tasking.
#[derive(Debug)]
pub struct TaskingTask {
    metadata: TaskMetadata,
    actions: ActionSpace,
}

const fn metadata(
    id: &'static str,
    description: &'static str,
    params: &'static [ParamSpec],
    options: &'static [OptionSpec],
    levels: &'static LazyLock<Levels>,
    start_rungs: &'static [f64],
) -> TaskMetadata {
    TaskMetadata { id, world: WORLD_ID, description, params, options, levels, start_rungs }
}

/// The tasks of tasking.
pub static TASKING_TASKS: [TaskingTask; 3] = [
    TaskingTask {
        metadata: metadata(
            "tasking/scanning",
            "Scan the ground below as long as possible, within power, storage and the speeds of the wheels.",
            &spaces::SCANNING_SPACE,
            &spaces::SCANNING_OPTIONS,
            &spaces::SCANNING_LEVELS,
            &spaces::SCANNING_START_RUNGS,
        ),
        actions: spaces::SCANNING_ACTIONS,
    },
    TaskingTask {
        metadata: metadata(
            "tasking/imaging",
            "Image the most valuable targets on the way, within power and the agility of the satellite.",
            &spaces::IMAGING_SPACE,
            &spaces::IMAGING_OPTIONS,
            &spaces::IMAGING_LEVELS,
            &spaces::IMAGING_START_RUNGS,
        ),
        actions: spaces::IMAGING_ACTIONS,
    },
    TaskingTask {
        metadata: metadata(
            "tasking/constellation",
            "Image targets with several satellites of one orbit, each target once.",
            &spaces::CONSTELLATION_SPACE,
            &spaces::CONSTELLATION_OPTIONS,
            &spaces::CONSTELLATION_LEVELS,
            &spaces::IMAGING_START_RUNGS,
        ),
        actions: spaces::IMAGING_ACTIONS,
    },
];

impl TaskSpec for TaskingTask {
    fn metadata(&self) -> &TaskMetadata {
        &self.metadata
    }

    /// A step lasts at least a second.
    fn horizon(&self, recipe: &Recipe) -> u32 {
        self.time_limit_s(recipe).map_or(0, |limit| limit as u32)
    }

    fn time_limit_s(&self, recipe: &Recipe) -> Option<f64> {
        recipe.param("time_limit_s")
    }

    fn agents(&self, recipe: &Recipe) -> u32 {
        recipe.param("satellites").map_or(1, |satellites| satellites as u32)
    }

    fn action_space(&self) -> ActionSpace {
        self.actions.clone()
    }

    fn action_grid(&self) -> ActionGrid {
        ActionGrid {
            axes: Axes::World,
            rows: (0..self.actions.names().len()).map(|index| vec![index as f32]).collect(),
            hold: None,
            description: "the actions by index",
        }
    }

    /// All agents dead to everything scanned or imaged.
    fn score_range(&self) -> ScoreRange {
        ScoreRange { min: -1.0, max: 1.0 }
    }

    fn check(&self, recipe: &Recipe) -> Result<(), ScenarioError> {
        TaskSetup::read(recipe).map(|_| ())
    }

    fn start(&self, scenario: &Scenario) -> Result<Box<dyn Episode>, ScenarioError> {
        Ok(Box::new(TaskingEpisode::start(scenario)?))
    }

    /// Replays the logs in lanes.
    fn replay_all(&self, items: &[ReplayItem<'_>]) -> Vec<Result<EpisodeOutcome, ReplayError>> {
        replay::replay_all(items)
    }

    fn bracket(&self, scenario: &Scenario) -> Result<Bracket, ScenarioError> {
        bracket::bracket(scenario)
    }

    /// Always `None`: scenarios are contested without additional threats.
    fn make_contested(&self, _: &Scenario) -> Option<(Scenario, Bracket)> {
        None
    }

    fn is_success(&self, outcome: &EpisodeOutcome, skill: Option<f64>) -> bool {
        outcome.lost == 0 && skill.is_some_and(|skill| skill >= SUCCESS_SKILL)
    }

    fn blind_can_succeed(&self) -> bool {
        true
    }

    fn read_step(&self, step: &Value, log: &mut ActionLog) -> Result<(), LogError> {
        codec::ACTION_FORMAT.read_entries(step, log)
    }

    fn read_observation(&self, value: &Value) -> serde_json::Result<Box<dyn Any + Send>> {
        Ok(Box::new(telemetry::TaskingTelemetry::deserialize(value)?))
    }

    fn batch(
        &self,
        source: Box<dyn ScenarioSource>,
        config: BatchConfig,
    ) -> Result<Box<dyn Batch>, BatchError> {
        lane::create_batch(self, source, config)
    }

    fn policies(&self) -> &'static [PolicySpec] {
        &policies::TASKING_POLICIES
    }

    fn reflex(&self) -> Reflex {
        policies::TASKING_REFLEX
    }

    fn failure_modes(&self) -> &'static [FailureModeSpec] {
        critique::failure_modes(self.metadata.id)
    }

    /// Satellites meet no other bodies.
    fn speed_bands(&self) -> SpeedBands {
        SpeedBands { edges: &[], unit: "m/s" }
    }

    fn sector_quantity(&self) -> SectorQuantity {
        critique::ORBIT_ANGLE
    }

    fn critique(&self, scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError> {
        critique::critique(scenario, log)
    }

    fn policy(&self, name: &str, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError> {
        policies::create_policy(name, scenario, seed)
    }
}
