//! Tasks of kessler: metadata, success rule, and the entry points of [`TaskSpec`].

use std::any::Any;
use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::Value;

use super::constants::{EPSILON, GOAL_THRESHOLD, HORIZON, SATELLITES};
use super::episode::KesslerEpisode;
use super::reward::Objective;
use super::setup::KesslerSetup;
use super::{WORLD_ID, batch, codec, critique, planner, policies, spaces, telemetry, threat_placement};
use crate::batch::{Batch, BatchConfig, BatchError, ScenarioSource};
use crate::bracket::{Bracket, EpisodeOutcome};
use crate::critique::{Critique, FailureModeSpec, Judgement, SectorQuantity, SpeedBands};
use crate::error::ReplayError;
use crate::error::{LogError, ScenarioError};
use crate::log::ActionLog;
use crate::policy::{Policy, PolicyError, PolicySpec};
use crate::reflex::Reflex;
use crate::space::{ActionGrid, ActionSpace, Levels, ParamSpec, ScoreRange};
use crate::task::{Episode, TaskMetadata, TaskSpec};
use crate::task::{Recipe, Scenario};

/// Skill from which an episode of survival or eco_station without losses is a success.
pub const MIN_SUCCESS_SKILL: f64 = 0.8;

/// One task of kessler.
#[derive(Debug)]
pub struct KesslerTask {
    metadata: TaskMetadata,
    objective: Objective,
}

const fn metadata(
    id: &'static str,
    description: &'static str,
    params: &'static [ParamSpec],
    levels: &'static LazyLock<Levels>,
) -> TaskMetadata {
    let options = &spaces::KESSLER_OPTIONS;
    TaskMetadata { id, world: WORLD_ID, description, params, options, levels, start_rungs: &[] }
}

/// All tasks, in the order in which the docs list them.
pub static KESSLER_TASKS: [KesslerTask; 4] = [
    KesslerTask {
        metadata: metadata(
            Objective::Survival.task_id(),
            "Keep three satellites alive for 50 steps.",
            &spaces::SURVIVAL_SPACE,
            &spaces::SURVIVAL_LEVELS,
        ),
        objective: Objective::Survival,
    },
    KesslerTask {
        metadata: metadata(
            Objective::EcoStation.task_id(),
            "Keep three satellites alive and their fuel unspent.",
            &spaces::ECO_STATION_SPACE,
            &spaces::ECO_STATION_LEVELS,
        ),
        objective: Objective::EcoStation,
    },
    KesslerTask {
        metadata: TaskMetadata {
            start_rungs: &spaces::RENDEZVOUS_START_RUNGS,
            ..metadata(
                Objective::Rendezvous.task_id(),
                "Bring satellite 0 to radius 100 LU and hold it there, without losing a satellite.",
                &spaces::RENDEZVOUS_SPACE,
                &spaces::RENDEZVOUS_LEVELS,
            )
        },
        objective: Objective::Rendezvous,
    },
    KesslerTask {
        metadata: metadata(
            Objective::Formation.task_id(),
            "Keep three satellites in a triangle of side 20 LU, without losing a satellite.",
            &spaces::FORMATION_SPACE,
            &spaces::FORMATION_LEVELS,
        ),
        objective: Objective::Formation,
    },
];

impl KesslerTask {
    /// Objective of the task.
    #[must_use]
    pub const fn objective(&self) -> Objective {
        self.objective
    }
}

impl TaskSpec for KesslerTask {
    fn metadata(&self) -> &TaskMetadata {
        &self.metadata
    }

    fn horizon(&self, _: &Recipe) -> u32 {
        HORIZON
    }

    fn agents(&self, _: &Recipe) -> u32 {
        SATELLITES as u32
    }

    fn action_space(&self) -> ActionSpace {
        spaces::ACTION_SPACE
    }

    fn agent_axes(&self) -> Option<&'static [&'static str]> {
        Some(&["radial", "in_track"])
    }

    fn action_grid(&self) -> ActionGrid {
        spaces::action_grid()
    }

    fn few_actions(&self) -> ActionGrid {
        spaces::few_actions()
    }

    fn score_range(&self) -> ScoreRange {
        ScoreRange { min: EPSILON, max: 1.0 - EPSILON }
    }

    fn check(&self, recipe: &Recipe) -> Result<(), ScenarioError> {
        KesslerSetup::from_recipe(recipe).map(|_| ())
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
        is_wanted: &dyn Fn() -> bool,
    ) -> Result<Option<Bracket>, ScenarioError> {
        let bracket = planner::bracket(self.objective, scenario, is_wanted)?;
        Ok(is_wanted().then_some(bracket))
    }

    fn make_contested(&self, scenario: &Scenario) -> Option<(Scenario, Bracket)> {
        threat_placement::place_contested_threat(scenario)
    }

    fn is_success(&self, outcome: &EpisodeOutcome, skill: Option<f64>) -> bool {
        outcome.lost == 0
            && match self.objective {
                Objective::Survival | Objective::EcoStation => skill.is_none_or(|s| s >= MIN_SUCCESS_SKILL),
                Objective::Rendezvous | Objective::Formation => {
                    outcome.goal.is_some_and(|g| g >= GOAL_THRESHOLD)
                }
            }
    }

    fn blind_can_succeed(&self) -> bool {
        matches!(self.objective, Objective::Survival | Objective::EcoStation)
    }

    fn read_step(&self, step: &Value, log: &mut ActionLog) -> Result<(), LogError> {
        codec::BURN_FORMAT.read_entries(step, log)
    }

    fn read_observation(&self, value: &Value) -> serde_json::Result<Box<dyn Any + Send>> {
        Ok(Box::new(telemetry::KesslerTelemetry::deserialize(value)?))
    }

    fn batch(
        &self,
        source: Box<dyn ScenarioSource>,
        config: BatchConfig,
    ) -> Result<Box<dyn Batch>, BatchError> {
        batch::batch(self.objective, self.metadata.id, source, config)
    }

    fn policies(&self) -> &'static [PolicySpec] {
        &policies::KESSLER_POLICIES
    }

    fn reflex(&self) -> Reflex {
        policies::KESSLER_REFLEX
    }

    fn failure_modes(&self) -> &'static [FailureModeSpec] {
        critique::failure_modes(self.objective)
    }

    fn speed_bands(&self) -> SpeedBands {
        critique::KESSLER_SPEED_BANDS
    }

    fn sector_quantity(&self) -> SectorQuantity {
        SectorQuantity::BEARING
    }

    fn critique(&self, scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError> {
        critique::critique(self.objective, scenario, log)
    }

    fn judge_step(&self, scenario: &Scenario, log: &ActionLog) -> Result<Option<Judgement>, ReplayError> {
        critique::judge_step(self.objective, scenario, log).map(Some)
    }

    fn policy(&self, name: &str, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError> {
        policies::by_name(name, self.objective, scenario, seed)
    }
}
