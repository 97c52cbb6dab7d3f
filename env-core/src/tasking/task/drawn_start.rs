//! The start that a scenario draws, as a layout.

use super::layout::{EpochDay, SatelliteStart, TaskingLayout};
use super::task_setup::TaskSetup;
use crate::episode_rng::SeededRng;
use crate::error::ScenarioError;
use crate::task::Scenario;

impl TaskingLayout {
    /// Returns epoch and satellites as a scenario starts with them, and the outages and targets of its layout.
    ///
    /// # Errors
    /// Returns the error of a recipe that is invalid.
    pub fn of_scenario(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let layout = Self::of_recipe(scenario.recipe())?.unwrap_or_default();
        let setup = TaskSetup::read(scenario.recipe())?.draw(&mut SeededRng::new(scenario.seed()));
        let satellites = setup.agents.iter().map(|agent| SatelliteStart::of_args(&agent.satellite.args));
        Ok(Self {
            epoch: Some(EpochDay::of_epoch(&setup.epoch)),
            satellites: Some(satellites.collect()),
            ..layout
        })
    }
}
