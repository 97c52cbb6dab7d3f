//! Recipes: what decides an episode, except for the seed.

use std::fmt;

use serde_json::{Map, Value, json};

use super::TaskSpec;
use super::layout::Layout;
use crate::canonical::Canonical;
use crate::error::ScenarioError;
use crate::space::param_names;
use crate::text::{MAX_QUOTED_CHARS, shorten};

/// A scenario without its seed: task, params, physics options and layout. Every instance is valid.
#[derive(Clone)]
pub struct Recipe {
    pub(super) task: &'static dyn TaskSpec,
    /// Values in the order of the task's parameter space.
    params: Vec<f64>,
    /// Index of the choice of each option, in the order of the task's options; 0 is the default.
    pub(super) options: Vec<usize>,
    layout: Option<Layout>,
}

/// Identity of a recipe: blake3 of its canonical form.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RecipeId(pub [u8; 32]);

impl fmt::Display for RecipeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl Recipe {
    /// The task with every param and option at its default.
    ///
    /// # Errors
    /// Returns the error of [`TaskSpec::check`] if the defaults contradict each other, which no task of this crate does.
    pub fn new(task: &'static dyn TaskSpec) -> Result<Self, ScenarioError> {
        Self::with_params(task, std::iter::empty())
    }

    /// The task at a level of its default table; a level past the last is the last.
    ///
    /// # Errors
    /// Returns the error of [`TaskSpec::check`] if the level's params contradict each other, which no default table does.
    pub fn at_level(task: &'static dyn TaskSpec, level: usize) -> Result<Self, ScenarioError> {
        Self::with_params(task, task.levels().params(level))
    }

    /// The task with these params, the others at their defaults.
    ///
    /// # Errors
    /// Returns an error if a param is unknown or out of its bounds, or if params contradict each other.
    pub fn with_params<'a>(
        task: &'static dyn TaskSpec,
        params: impl Iterator<Item = (&'a str, f64)>,
    ) -> Result<Self, ScenarioError> {
        let mut recipe = Self {
            task,
            params: task.params().iter().map(|spec| spec.default).collect(),
            options: vec![0; task.options().len()],
            layout: None,
        };
        for (name, value) in params {
            recipe.set_param(name, value)?;
        }
        task.check(&recipe)?;
        Ok(recipe)
    }

    /// Sets one param.
    ///
    /// # Errors
    /// Returns an error if the param is unknown or out of its bounds, or contradicts another.
    pub fn with_param(mut self, name: &str, value: f64) -> Result<Self, ScenarioError> {
        self.set_param(name, value)?;
        self.task.check(&self)?;
        Ok(self)
    }

    /// Sets or removes the layout.
    ///
    /// # Errors
    /// Returns an error if the world does not accept the layout, or if it has too many bodies.
    pub fn with_layout(mut self, layout: Option<Layout>) -> Result<Self, ScenarioError> {
        self.layout = layout;
        self.task.check(&self)?;
        Ok(self)
    }

    /// Task of the recipe.
    #[must_use]
    pub fn task(&self) -> &'static dyn TaskSpec {
        self.task
    }

    /// The value of a param, or `None` if the task has no such param.
    #[must_use]
    pub fn param(&self, name: &str) -> Option<f64> {
        let index = self.task.params().iter().position(|spec| spec.name == name)?;
        self.params.get(index).copied()
    }

    /// All params in the order of the task's parameter space.
    #[must_use]
    pub fn params(&self) -> &[f64] {
        &self.params
    }

    /// The layout, if any.
    #[must_use]
    pub fn layout(&self) -> Option<&Layout> {
        self.layout.as_ref()
    }

    /// The canonical bytes. Values at their default are left out, so that a new option changes no existing id; defaults
    /// are part of the world's version.
    #[must_use]
    pub fn canonical(&self) -> Vec<u8> {
        let mut out = Canonical::new("sparring-recipe/1");
        out.text(self.task.world());
        out.text(self.task.id());
        let params = self.task.params().iter().zip(&self.params);
        let params: Vec<_> = params.filter(|(spec, value)| spec.default != **value).collect();
        out.count(params.len());
        for (spec, value) in params {
            out.text(spec.name);
            out.number(*value);
        }
        let options = self.task.options().iter().zip(&self.options);
        let options: Vec<_> = options.filter(|(_, choice)| **choice != 0).collect();
        out.count(options.len());
        for (spec, &choice) in options {
            out.text(spec.name);
            out.text(spec.choices[choice]);
        }
        out.count(usize::from(self.layout.is_some()));
        if let Some(layout) = &self.layout {
            out.text(layout.mode.name());
            out.count(layout.bodies.len());
            for (table, rows) in &layout.bodies {
                out.text(table);
                out.count(rows.len());
                for row in rows {
                    out.count(row.len());
                    row.iter().for_each(|&value| out.number(value));
                }
            }
        }
        out.finish()
    }

    /// The id: blake3 of the canonical bytes.
    #[must_use]
    pub fn id(&self) -> RecipeId {
        RecipeId(*blake3::hash(&self.canonical()).as_bytes())
    }

    /// The recipe as JSON, with every param and option written out.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let params = self.task.params().iter().zip(&self.params);
        let params: Map<String, Value> =
            params.map(|(spec, &value)| (spec.name.to_owned(), json!(value))).collect();
        let options = self.task.options().iter().zip(&self.options);
        let options: Map<String, Value> =
            options.map(|(spec, &choice)| (spec.name.to_owned(), json!(spec.choices[choice]))).collect();
        json!({
            "world": self.task.world(),
            "task": self.task.id(),
            "params": params,
            "physics": options,
            "layout": self.layout.as_ref().map(Layout::to_json),
        })
    }

    fn set_param(&mut self, name: &str, value: f64) -> Result<(), ScenarioError> {
        let space = self.task.params();
        let Some(index) = space.iter().position(|spec| spec.name == name) else {
            return Err(ScenarioError::UnknownField {
                field: format!("params.{}", shorten(name, MAX_QUOTED_CHARS)),
                known: param_names(space),
            });
        };
        self.params[index] = space[index].check(value)?;
        Ok(())
    }
}

impl fmt::Debug for Recipe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Recipe({})", self.to_json())
    }
}

impl PartialEq for Recipe {
    fn eq(&self, other: &Self) -> bool {
        self.canonical() == other.canonical()
    }
}
