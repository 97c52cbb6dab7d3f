//! The physics options of a recipe.

use std::collections::BTreeMap;

use super::recipe::Recipe;
use crate::error::ScenarioError;
use crate::text::{MAX_QUOTED_CHARS, shorten};

/// Name of the scenario's field with the options; errors of options are located under it.
pub const PHYSICS: &str = "physics";

impl Recipe {
    /// Sets one physics option.
    ///
    /// # Errors
    /// Returns an error if the option or the choice is unknown, or contradicts another option.
    pub fn with_option(self, name: &str, choice: &str) -> Result<Self, ScenarioError> {
        self.with_options(std::iter::once((name, choice)))
    }

    /// Sets several physics options, given as pairs of name and choice. They are checked together.
    ///
    /// # Errors
    /// Returns an error if an option or a choice is unknown, or if options contradict each other.
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

    /// The choice of a physics option, or `None` if the task has no such option.
    #[must_use]
    pub fn option(&self, name: &str) -> Option<&'static str> {
        let specs = self.task.options();
        let index = specs.iter().position(|spec| spec.name == name)?;
        specs[index].choices.get(self.options[index]).copied()
    }

    /// The options that are not at their defaults: choices by name.
    #[must_use]
    pub fn chosen_options(&self) -> BTreeMap<&'static str, &'static str> {
        let chosen = self.task.options().iter().zip(&self.options).filter(|(_, choice)| **choice != 0);
        chosen.map(|(spec, &choice)| (spec.name, spec.choices[choice])).collect()
    }

    /// Checks that a run or a suite may draw many scenarios from the recipe.
    ///
    /// # Errors
    /// Returns [`ScenarioError::Layout`] with the option if its choice is reserved for scenarios made by hand.
    pub fn check_for_series(&self) -> Result<(), ScenarioError> {
        for (spec, &choice) in self.task.options().iter().zip(&self.options) {
            let word = spec.choices[choice];
            if let Some(reserved) = spec.manual_choices.iter().find(|reserved| reserved.choice == word) {
                return Err(ScenarioError::Layout {
                    field: format!("{PHYSICS}.{}", spec.name),
                    reason: format!(
                        "must not be {word}, which only scenarios made by hand may have: {}",
                        reserved.reason
                    ),
                });
            }
        }
        Ok(())
    }

    /// Sets one option without checking it against the others.
    pub(crate) fn set_option(&mut self, name: &str, choice: &str) -> Result<(), ScenarioError> {
        let specs = self.task.options();
        let Some(index) = specs.iter().position(|spec| spec.name == name) else {
            return Err(ScenarioError::UnknownField {
                field: format!("{PHYSICS}.{}", shorten(name, MAX_QUOTED_CHARS)),
                known: specs.iter().map(|spec| spec.name).collect::<Vec<_>>().join(", "),
            });
        };
        let Some(chosen) = specs[index].choices.iter().position(|&word| word == choice) else {
            return Err(ScenarioError::UnknownChoice {
                field: format!("{PHYSICS}.{name}"),
                value: shorten(choice, MAX_QUOTED_CHARS),
                choices: specs[index].choices.join(", "),
            });
        };
        self.options[index] = chosen;
        Ok(())
    }
}
