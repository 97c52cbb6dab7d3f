//! The physics options of a recipe.

use std::collections::BTreeMap;

use super::Recipe;
use super::read::shorten;
use crate::error::ScenarioError;

/// Where options stand in a scenario: the field errors begin with.
pub const PHYSICS: &str = "physics";

impl Recipe {
    /// The same with one physics option set.
    ///
    /// # Errors
    /// An unknown option or choice, or one that contradicts another.
    pub fn with_option(self, name: &str, choice: &str) -> Result<Self, ScenarioError> {
        self.with_options(std::iter::once((name, choice)))
    }

    /// The same with these physics options set, which are judged together.
    ///
    /// # Errors
    /// An unknown option or choice, or some that contradict each other.
    pub fn with_options<'a>(
        mut self,
        options: impl Iterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, ScenarioError> {
        for (name, choice) in options {
            self.set_option(name, choice)?;
        }
        self.task.check(&self)?;
        Ok(self)
    }

    pub(super) fn set_option(&mut self, name: &str, choice: &str) -> Result<(), ScenarioError> {
        let specs = self.task.options();
        let Some(index) = specs.iter().position(|spec| spec.name == name) else {
            return Err(ScenarioError::UnknownField {
                field: format!("{PHYSICS}.{}", shorten(name)),
                known: specs.iter().map(|s| s.name).collect::<Vec<_>>().join(", "),
            });
        };
        let Some(chosen) = specs[index].choices.iter().position(|&word| word == choice) else {
            return Err(ScenarioError::UnknownChoice {
                field: format!("{PHYSICS}.{name}"),
                value: shorten(choice),
                choices: specs[index].choices.join(", "),
            });
        };
        self.options[index] = chosen;
        Ok(())
    }

    /// The word chosen for a physics option; `None` if the task has no such option.
    #[must_use]
    pub fn option(&self, name: &str) -> Option<&'static str> {
        let specs = self.task.options();
        let index = specs.iter().position(|spec| spec.name == name)?;
        specs[index].choices.get(self.options[index]).copied()
    }

    /// The options that are not at their defaults, and the words chosen for them.
    #[must_use]
    pub fn chosen_options(&self) -> BTreeMap<&'static str, &'static str> {
        let chosen = self.task.options().iter().zip(&self.options).filter(|(_, at)| **at != 0);
        chosen.map(|(spec, &at)| (spec.name, spec.choices[at])).collect()
    }

    /// Whether scenarios may be drawn from it by the number, for a run or a suite: choices that make sense by hand only
    /// are refused.
    ///
    /// # Errors
    /// The option, and what its choice is for.
    pub fn check_for_series(&self) -> Result<(), ScenarioError> {
        for (spec, &at) in self.task.options().iter().zip(&self.options) {
            let word = spec.choices[at];
            if let Some(reserved) = spec.by_hand.iter().find(|reserved| reserved.choice == word) {
                return Err(ScenarioError::Layout {
                    field: format!("{PHYSICS}.{}", spec.name),
                    reason: format!("{word} is for scenarios by hand: {}", reserved.why),
                });
            }
        }
        Ok(())
    }
}
