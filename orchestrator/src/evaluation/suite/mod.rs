//! Frozen sets of held-out scenarios.

pub mod error;
pub mod file;

use std::sync::Arc;

use env_core::{Bracket, Recipe, Scenario, TaskSpec};

pub use self::error::SuiteError;

/// A frozen set of scenarios with their brackets.
#[derive(Debug, Clone, PartialEq)]
pub struct Suite {
    /// What it is called.
    pub name: String,
    /// Version of the planner that made the brackets; the newest where tasks of several worlds are in it.
    pub planner: u32,
    /// The program and the arguments that made it.
    pub created_by: String,
    /// The scenarios, those of one task and level together.
    pub groups: Vec<Group>,
}

/// The scenarios of one task and level.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// The level whose params the recipe has.
    pub level: usize,
    /// What they share.
    pub recipe: Arc<Recipe>,
    /// The scenarios.
    pub entries: Vec<Entry>,
}

impl Group {
    /// Version of the planner that made its brackets; none without scenarios.
    #[must_use]
    pub fn planner(&self) -> Option<u32> {
        self.entries.first().map(|entry| entry.bracket.planner)
    }
}

/// One scenario of a suite.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Why it is here.
    pub part: Part,
    /// The scenario.
    pub scenario: Scenario,
    /// What it is worth. A suite stores no witness: the log is empty.
    pub bracket: Bracket,
}

/// How a scenario came into a suite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Drawn until it was contested: acting well matters on it.
    Contested,
    /// Drawn once and kept, contested or not.
    AsTheyCome,
}

impl Suite {
    /// The tasks, each once, in order.
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

    /// All scenarios, in order.
    pub fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.groups.iter().flat_map(|group| &group.entries)
    }
}
