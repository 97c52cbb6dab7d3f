//! Suites: frozen sets of held-out scenarios with their brackets. [`file`] reads and writes them.

pub mod error;
pub mod file;

use std::sync::Arc;

use env_core::{Bracket, Recipe, Scenario, TaskSpec};

pub use self::error::SuiteError;

/// Frozen set of scenarios with their brackets.
#[derive(Debug, Clone, PartialEq)]
pub struct Suite {
    /// Name of the suite.
    pub name: String,
    /// Version of the planner that made the brackets; the newest one if the suite has tasks of several worlds.
    pub planner: u32,
    /// Command line that built the suite.
    pub created_by: String,
    /// Scenarios, grouped by task and level.
    pub groups: Vec<SuiteGroup>,
}

/// Scenarios of one task and level.
#[derive(Debug, Clone, PartialEq)]
pub struct SuiteGroup {
    /// Level whose params the recipe has.
    pub level: usize,
    /// Recipe of all scenarios.
    pub recipe: Arc<Recipe>,
    /// Scenarios of the group.
    pub entries: Vec<SuiteEntry>,
}

impl SuiteGroup {
    /// Returns the version of the planner that made the brackets; `None` without scenarios.
    #[must_use]
    pub fn planner(&self) -> Option<u32> {
        self.entries.first().map(|entry| entry.bracket.planner_version)
    }
}

/// Scenario of a suite with its bracket.
#[derive(Debug, Clone, PartialEq)]
pub struct SuiteEntry {
    /// Part of the suite that the scenario belongs to.
    pub part: SuitePart,
    /// Scenario with an evaluation seed.
    pub scenario: Scenario,
    /// Bracket of the scenario. A suite does not store the reference's plan, which is empty here.
    pub bracket: Bracket,
}

/// Part of a suite, by how its scenarios were selected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SuitePart {
    /// Contested scenarios: acting well matters. Others were rejected.
    Contested,
    /// Scenarios as they were drawn, contested or not.
    AsTheyCome,
}

impl Suite {
    /// Returns the distinct tasks, in order.
    #[must_use]
    pub fn tasks(&self) -> Vec<&'static dyn TaskSpec> {
        let mut tasks: Vec<&'static dyn TaskSpec> = Vec::new();
        for group in &self.groups {
            let task = group.recipe.task();
            if !tasks.iter().any(|known| known.id() == task.id()) {
                tasks.push(task);
            }
        }
        tasks
    }

    /// Returns all scenarios, in order.
    pub fn entries(&self) -> impl Iterator<Item = &SuiteEntry> {
        self.groups.iter().flat_map(|group| &group.entries)
    }
}
