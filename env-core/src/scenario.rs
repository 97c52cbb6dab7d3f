//! Recipes and scenarios: what decides an episode, complete and self-contained.

mod layout;
mod options;
mod read;

use std::fmt;
use std::sync::Arc;

use serde_json::{Map, Value, json};

pub use self::layout::{Layout, LayoutMode, MAX_LAYOUT_ROWS};
pub use self::options::PHYSICS;
use self::read::{known, number, object, shorten, text, wrong};
use crate::canonical::Canonical;
use crate::error::ScenarioError;
use crate::registry;
use crate::seed::Seed;
use crate::space::names;
use crate::task::TaskSpec;

/// A scenario without its seed: world, task, params, physics options, layout. A recipe that exists is valid.
#[derive(Clone)]
pub struct Recipe {
    task: &'static dyn TaskSpec,
    params: Vec<f64>,
    options: Vec<usize>,
    layout: Option<Layout>,
}

/// The blake3 of a recipe's canonical form.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RecipeId(pub [u8; 32]);

/// The blake3 of a scenario's canonical form.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ScenarioId(pub [u8; 32]);

impl fmt::Display for RecipeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl fmt::Display for ScenarioId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl Recipe {
    /// The task with every param and option at its default.
    ///
    /// # Errors
    /// Never for the tasks of this crate; the signature is that of [`Recipe::with_params`].
    pub fn new(task: &'static dyn TaskSpec) -> Result<Self, ScenarioError> {
        Self::with_params(task, std::iter::empty())
    }

    /// The task with these params, the others at their defaults.
    ///
    /// # Errors
    /// An unknown param, or one out of its bounds.
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

    /// The same with one param set.
    ///
    /// # Errors
    /// An unknown param, or one out of its bounds.
    pub fn with_param(mut self, name: &str, value: f64) -> Result<Self, ScenarioError> {
        self.set_param(name, value)?;
        self.task.check(&self)?;
        Ok(self)
    }

    fn set_param(&mut self, name: &str, value: f64) -> Result<(), ScenarioError> {
        let space = self.task.params();
        let Some(index) = space.iter().position(|spec| spec.name == name) else {
            return Err(ScenarioError::UnknownField {
                field: format!("params.{}", shorten(name)),
                known: names(space),
            });
        };
        self.params[index] = space[index].check(value)?;
        Ok(())
    }

    /// The same with this layout.
    ///
    /// # Errors
    /// A layout the world does not understand, or with too many bodies.
    pub fn with_layout(mut self, layout: Option<Layout>) -> Result<Self, ScenarioError> {
        self.layout = layout;
        self.task.check(&self)?;
        Ok(self)
    }

    /// The task.
    #[must_use]
    pub fn task(&self) -> &'static dyn TaskSpec {
        self.task
    }

    /// A param by its name; `None` if the task has no such param.
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

    /// The canonical bytes. What stands at its default is left out, so that an option added later changes no id: a
    /// default is part of the world's version.
    #[must_use]
    pub fn canonical(&self) -> Vec<u8> {
        let mut out = Canonical::new("sparring-recipe/1");
        out.text(self.task.world());
        out.text(self.task.id());
        let set = |(spec, value): &(&crate::space::ParamSpec, &f64)| spec.default != **value;
        let params: Vec<_> = self.task.params().iter().zip(&self.params).filter(set).collect();
        out.count(params.len());
        for (spec, value) in params {
            out.text(spec.name);
            out.number(*value);
        }
        let options: Vec<_> =
            self.task.options().iter().zip(&self.options).filter(|(_, o)| **o != 0).collect();
        out.count(options.len());
        for (spec, &chosen) in options {
            out.text(spec.name);
            out.text(spec.choices[chosen]);
        }
        out.count(usize::from(self.layout.is_some()));
        if let Some(layout) = &self.layout {
            out.text(layout.mode.word());
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

    /// The wire form: every param and option is written out.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let params: Map<String, Value> = self
            .task
            .params()
            .iter()
            .zip(&self.params)
            .map(|(s, &v)| (s.name.to_owned(), json!(v)))
            .collect();
        let physics: Map<String, Value> = self
            .task
            .options()
            .iter()
            .zip(&self.options)
            .map(|(spec, &chosen)| (spec.name.to_owned(), json!(spec.choices[chosen])))
            .collect();
        json!({
            "world": self.task.world(),
            "task": self.task.id(),
            "params": params,
            "physics": physics,
            "layout": self.layout.as_ref().map(Layout::to_json),
        })
    }

    /// Reads the wire form. Params and options not given stand at their defaults.
    ///
    /// # Errors
    /// Anything unknown, missing or out of range, by field.
    pub fn from_json(value: &Value) -> Result<Self, ScenarioError> {
        let fields = object("scenario", value)?;
        known("", fields, &["world", "task", "params", "physics", "layout"])?;
        Self::from_fields(fields)
    }

    fn from_fields(fields: &Map<String, Value>) -> Result<Self, ScenarioError> {
        let id = text("task", fields.get("task"), "a task's id, as kessler/survival")?;
        let Some(task) = registry::task(id) else {
            return Err(ScenarioError::UnknownChoice {
                field: "task".to_owned(),
                value: shorten(id),
                choices: registry::tasks().map(TaskSpec::id).collect::<Vec<_>>().join(", "),
            });
        };
        if let Some(world) = fields.get("world") {
            let word = text("world", Some(world), "a world and its version")?;
            if word != task.world() {
                return Err(ScenarioError::UnknownChoice {
                    field: "world".to_owned(),
                    value: shorten(word),
                    choices: task.world().to_owned(),
                });
            }
        }
        let mut params = Vec::new();
        if let Some(given) = fields.get("params").filter(|v| !v.is_null()) {
            for (name, value) in object("params", given)? {
                params.push((name.as_str(), number(&format!("params.{}", shorten(name)), value)?));
            }
        }
        let mut recipe = Self::with_params(task, params.into_iter())?;
        if let Some(given) = fields.get("physics").filter(|v| !v.is_null()) {
            for (name, choice) in object("physics", given)? {
                let name = shorten(name);
                let choice = text(&format!("physics.{name}"), Some(choice), "a word")?;
                recipe.set_option(&name, choice)?;
            }
        }
        let layout = match fields.get("layout") {
            None | Some(Value::Null) => None,
            Some(given) => Some(Layout::from_json(given)?),
        };
        recipe.with_layout(layout)
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

/// A recipe and its seed: complete. `(scenario, actions)` decides every bit of the episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    recipe: Arc<Recipe>,
    seed: Seed,
}

impl Scenario {
    /// This recipe with this seed.
    #[must_use]
    pub fn new(recipe: impl Into<Arc<Recipe>>, seed: Seed) -> Self {
        Self { recipe: recipe.into(), seed }
    }

    /// The recipe.
    #[must_use]
    pub fn recipe(&self) -> &Arc<Recipe> {
        &self.recipe
    }

    /// The seed.
    #[must_use]
    pub const fn seed(&self) -> Seed {
        self.seed
    }

    /// The task.
    #[must_use]
    pub fn task(&self) -> &'static dyn TaskSpec {
        self.recipe.task
    }

    /// The canonical bytes: the recipe's, then the seed.
    #[must_use]
    pub fn canonical(&self) -> Vec<u8> {
        let mut out = Canonical::new("sparring-scenario/1");
        out.whole(self.seed.get());
        let mut bytes = out.finish();
        bytes.extend_from_slice(&self.recipe.canonical());
        bytes
    }

    /// The id: blake3 of the canonical bytes.
    #[must_use]
    pub fn id(&self) -> ScenarioId {
        ScenarioId(*blake3::hash(&self.canonical()).as_bytes())
    }

    /// The wire form, complete.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let mut value = self.recipe.to_json();
        value["seed"] = json!(self.seed.get());
        value
    }

    /// Reads the wire form. The seed may be of any space: callers who must not choose evaluation seeds check that.
    ///
    /// # Errors
    /// Anything unknown, missing or out of range, by field.
    pub fn from_json(value: &Value) -> Result<Self, ScenarioError> {
        let fields = object("scenario", value)?;
        known("", fields, &["world", "task", "params", "physics", "layout", "seed"])?;
        let seed = match fields.get("seed") {
            None => {
                return Err(ScenarioError::Missing {
                    field: "seed".to_owned(),
                    wanted: crate::seed::SEED_WANTED.to_owned(),
                });
            }
            Some(value) => {
                Seed::new(value.as_u64().ok_or_else(|| wrong("seed", value, crate::seed::SEED_WANTED))?)?
            }
        };
        Ok(Self::new(Recipe::from_fields(fields)?, seed))
    }
}
