//! Parameter spaces, options, levels and the shapes of actions and scores: tasks described as data.

use serde::Serialize;

use crate::batch::Axes;
use crate::error::ScenarioError;

/// Which way a parameter makes a task harder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Harder {
    /// A larger value is harder.
    Up,
    /// A smaller value is harder.
    Down,
}

/// One number that makes a task easier or harder.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParamSpec {
    /// Its name on the wire.
    pub name: &'static str,
    /// Its unit, empty for a pure number.
    pub unit: &'static str,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// The grid designers move on; values of a `whole` parameter must be whole.
    pub step: f64,
    /// Whether only whole numbers make sense.
    pub whole: bool,
    /// What the world's public original uses.
    pub default: f64,
    /// Which way is harder.
    pub harder: Harder,
    /// What it does.
    pub about: &'static str,
}

impl ParamSpec {
    /// Checks a value against kind and bounds.
    ///
    /// # Errors
    /// `OutOfRange`, or `WrongType` for a fraction where only whole numbers make sense.
    pub fn check(&self, value: f64) -> Result<f64, ScenarioError> {
        let field = || format!("params.{}", self.name);
        if !(value >= self.min && value <= self.max) {
            return Err(ScenarioError::OutOfRange { field: field(), value, min: self.min, max: self.max });
        }
        if self.whole && libm::floor(value) != value {
            return Err(ScenarioError::WrongType {
                field: field(),
                found: value.to_string(),
                wanted: "a whole number".to_owned(),
            });
        }
        Ok(value + 0.0) // −0.0 becomes 0.0: one value, one canonical form
    }
}

/// A choice between named behaviours of a world. What is served of it and what help texts say comes from here, and
/// recipes are checked against it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OptionSpec {
    /// Its name on the wire.
    pub name: &'static str,
    /// The words it takes; the first is the default.
    pub choices: &'static [&'static str],
    /// What it does.
    pub about: &'static str,
    /// The choices that only a scenario by hand may have, no run and no suite.
    pub by_hand: &'static [ByHand],
}

/// A choice that only a scenario by hand may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct ByHand {
    /// The word.
    pub choice: &'static str,
    /// Why, as the end of a sentence.
    pub why: &'static str,
}

impl OptionSpec {
    /// The word that stands where none is given.
    #[must_use]
    pub fn default_choice(&self) -> &'static str {
        self.choices.first().copied().unwrap_or_default()
    }
}

impl Serialize for OptionSpec {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut out = serializer.serialize_struct("OptionSpec", 6)?;
        out.serialize_field("name", self.name)?;
        // All options are words so far; a client should not have to guess.
        out.serialize_field("type", "choice")?;
        out.serialize_field("choices", self.choices)?;
        out.serialize_field("default", self.default_choice())?;
        out.serialize_field("about", self.about)?;
        out.serialize_field("by_hand", self.by_hand)?;
        out.end()
    }
}

/// A table of params from easy (row 0) to hard.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Levels {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Levels {
    /// A world's own table of ten levels, column by column.
    pub(crate) fn committed(space: &[ParamSpec], columns: &[(&str, [f64; 10])]) -> Self {
        let names = columns.iter().map(|(name, _)| (*name).to_owned()).collect();
        let rows = (0..10).map(|level| columns.iter().map(|(_, values)| values[level]).collect()).collect();
        Self::new(space, names, rows)
            .expect("the committed tables are within their spaces: a test reads them all")
    }

    /// A table whose every cell is checked against the task's parameter space.
    ///
    /// # Errors
    /// An unknown column, a row with a hole, a value out of its bounds, no rows or more than 100.
    pub fn new(
        space: &[ParamSpec],
        columns: Vec<String>,
        rows: Vec<Vec<f64>>,
    ) -> Result<Self, ScenarioError> {
        let mut specs = Vec::with_capacity(columns.len());
        for name in &columns {
            let Some(spec) = space.iter().find(|spec| spec.name == name) else {
                return Err(ScenarioError::UnknownField {
                    field: format!("levels.columns.{name}"),
                    known: names(space),
                });
            };
            specs.push(spec);
        }
        if rows.is_empty() || rows.len() > 100 {
            return Err(ScenarioError::Layout {
                field: "levels.rows".to_owned(),
                reason: format!("{} rows; a table has 1 to 100", rows.len()),
            });
        }
        for (level, row) in rows.iter().enumerate() {
            if row.len() != columns.len() {
                return Err(ScenarioError::Layout {
                    field: format!("levels.rows.{level}"),
                    reason: format!("{} values for {} columns", row.len(), columns.len()),
                });
            }
            for (spec, &value) in specs.iter().zip(row) {
                spec.check(value)?;
            }
        }
        Ok(Self { columns, rows })
    }

    /// How many levels there are (at least one).
    #[must_use]
    pub const fn len(&self) -> usize {
        self.rows.len()
    }

    /// Never: a table has at least one row.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The names of the columns.
    #[must_use]
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// The params of a level as (name, value); a level past the last is the last.
    pub fn params(&self, level: usize) -> impl Iterator<Item = (&str, f64)> {
        let row = &self.rows[level.min(self.rows.len() - 1)];
        self.columns.iter().map(String::as_str).zip(row.iter().copied())
    }
}

/// What an agent does in a step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ActionSpace {
    /// Names of the values of one action, in order.
    pub columns: &'static [&'static str],
    /// Smallest value each is clamped to.
    pub low: f64,
    /// Largest value each is clamped to.
    pub high: f64,
    /// The unit of the values.
    pub unit: &'static str,
}

/// Actions to choose from by their number, for policies that choose among few.
#[derive(Debug, Clone, PartialEq)]
pub struct Choices {
    /// Along which axes the actions are.
    pub axes: Axes,
    /// Their values, in order; the first is hold.
    pub rows: Vec<Vec<f32>>,
    /// What they are, in one sentence.
    pub about: &'static str,
}

/// The range of a task's score.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ScoreRange {
    /// Never below.
    pub min: f64,
    /// Never above.
    pub max: f64,
}

/// The names of a parameter space, for messages.
#[must_use]
pub fn names(space: &[ParamSpec]) -> String {
    space.iter().map(|spec| spec.name).collect::<Vec<_>>().join(", ")
}
