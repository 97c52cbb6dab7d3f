//! Parameter spaces, options, levels and the shapes of actions and scores: tasks described as data.

use serde::Serialize;

use crate::error::ScenarioError;
use crate::number_format::format_shortest;

/// Direction in which a param makes a task harder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Harder {
    /// A larger value is harder.
    Up,
    /// A smaller value is harder.
    Down,
}

/// A param: a number that determines the difficulty of a task.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParamSpec {
    /// Name of the param in JSON.
    pub name: &'static str,
    /// Unit of the param, empty for a pure number.
    pub unit: &'static str,
    /// Smallest value that is valid.
    pub min: f64,
    /// Largest value that is valid.
    pub max: f64,
    /// Grid of designers; values of a `whole` param must be integers.
    pub step: f64,
    /// True if only integers are valid.
    pub whole: bool,
    /// Default value: that of the world's public original.
    pub default: f64,
    /// Direction in which the task becomes harder.
    pub harder: Harder,
    /// Description of the param.
    pub description: &'static str,
}

impl ParamSpec {
    /// Checks a value and returns it in canonical form.
    ///
    /// # Errors
    /// Returns [`ScenarioError::OutOfRange`] if the value is out of bounds, and [`ScenarioError::WrongType`] if it must be an
    /// integer and is not.
    pub fn check(&self, value: f64) -> Result<f64, ScenarioError> {
        ScenarioError::check_range(format_args!("params.{}", self.name), value, self.min, self.max)?;
        if self.whole && libm::floor(value) != value {
            return Err(ScenarioError::WrongType {
                field: format!("params.{}", self.name),
                found: format_shortest(value),
                wanted: "an integer".to_owned(),
            });
        }
        Ok(value + 0.0) // −0.0 becomes 0.0, so that equal values have one canonical form
    }
}

/// Param that makes the start of an episode easier, in tasks that have start rungs. Tasks describe its effect.
pub const START_SCALE: ParamSpec = ParamSpec {
    name: "start_scale",
    unit: "",
    min: 0.01,
    max: 1.0,
    step: 0.01,
    whole: false,
    default: 1.0,
    harder: Harder::Up,
    description: "",
};

/// A physics option: a choice between named behaviours of a world. The API and help texts describe it by this, and recipes
/// are checked against it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OptionSpec {
    /// Name of the option in JSON.
    pub name: &'static str,
    /// Names of the choices; the first is the default.
    pub choices: &'static [&'static str],
    /// Description of the option.
    pub description: &'static str,
    /// Choices that are reserved for scenarios made by hand; runs and suites reject them.
    pub manual_choices: &'static [ManualChoice],
}

/// A choice that is reserved for scenarios made by hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct ManualChoice {
    /// Name of the choice.
    pub choice: &'static str,
    /// Reason, as the end of a sentence.
    pub reason: &'static str,
}

impl OptionSpec {
    /// Name of the default choice.
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
        // All options are choices so far; the type is explicit for clients.
        out.serialize_field("type", "choice")?;
        out.serialize_field("choices", self.choices)?;
        out.serialize_field("default", self.default_choice())?;
        out.serialize_field("description", self.description)?;
        out.serialize_field("manual_choices", self.manual_choices)?;
        out.end()
    }
}

/// A table of levels: params of each level, from easy (row 0) to hard.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Levels {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Levels {
    /// Creates a world's default table of ten levels from pairs of column name and values.
    pub(crate) fn from_table(space: &[ParamSpec], columns: &[(&str, [f64; 10])]) -> Self {
        let names = columns.iter().map(|(name, _)| (*name).to_owned()).collect();
        let rows = (0..10).map(|level| columns.iter().map(|(_, values)| values[level]).collect()).collect();
        Self::new(space, names, rows).expect("default tables are within their spaces, which a test checks")
    }

    /// Creates a table after checking every value against the task's parameter space.
    ///
    /// # Errors
    /// Returns an error if a column is unknown, a row has a wrong length, a value is out of bounds, or the number of rows is
    /// not within 1 to 100.
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
                    known: param_names(space),
                });
            };
            specs.push(spec);
        }
        if rows.is_empty() || rows.len() > 100 {
            return Err(ScenarioError::Layout {
                field: "levels.rows".to_owned(),
                reason: format!("must have 1 to 100 rows, got {}", rows.len()),
            });
        }
        for (level, row) in rows.iter().enumerate() {
            if row.len() != columns.len() {
                return Err(ScenarioError::Layout {
                    field: format!("levels.rows.{level}"),
                    reason: format!(
                        "must have {} values, one for each column, got {}",
                        columns.len(),
                        row.len()
                    ),
                });
            }
            for (column, (spec, &value)) in specs.iter().zip(row).enumerate() {
                let cell = format!("levels.rows.{level}.{column}");
                spec.check(value).map_err(|error| error.relocate(&format!("params.{}", spec.name), &cell))?;
            }
        }
        Ok(Self { columns, rows })
    }

    /// Number of levels, at least one.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.rows.len()
    }

    /// Always false, since a table has at least one row.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Names of the columns, which are params.
    #[must_use]
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Params of a level as pairs of name and value; a level past the last is the last.
    pub fn params(&self, level: usize) -> impl Iterator<Item = (&str, f64)> {
        let row = &self.rows[level.min(self.rows.len() - 1)];
        self.columns.iter().map(String::as_str).zip(row.iter().copied())
    }
}

/// Kind of an action's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActionKind {
    /// Numbers within the bounds.
    Box,
    /// The index of one of several actions.
    Discrete {
        /// Names of the actions, by index.
        names: &'static [&'static str],
    },
}

/// Action space of one agent.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionSpace {
    /// Kind of the values.
    pub kind: ActionKind,
    /// Names of the values of an action, in order.
    pub columns: &'static [&'static str],
    /// Smallest value. In a box lower ones are clamped.
    pub low: f64,
    /// Largest value. In a box higher ones are clamped.
    pub high: f64,
    /// Unit of the values.
    pub unit: &'static str,
    /// Value of an agent that does nothing new. In batches every value of its action equals this one; logs have no entry for it.
    pub hold: f32,
}

impl ActionSpace {
    /// Value of a discrete action by which an agent goes on with the action before.
    pub const GO_ON: f32 = -1.0;

    /// A box of values in the same bounds. An agent whose values are zero holds.
    #[must_use]
    pub const fn new_box(columns: &'static [&'static str], low: f64, high: f64, unit: &'static str) -> Self {
        Self { kind: ActionKind::Box, columns, low, high, unit, hold: 0.0 }
    }

    /// A choice of named actions. An agent goes on with the action before by [`ActionSpace::GO_ON`].
    #[must_use]
    pub const fn discrete(names: &'static [&'static str]) -> Self {
        Self {
            kind: ActionKind::Discrete { names },
            columns: &["action"],
            low: 0.0,
            high: names.len() as f64 - 1.0,
            unit: "",
            hold: Self::GO_ON,
        }
    }

    /// Number of values of an action.
    #[must_use]
    pub const fn dim(&self) -> usize {
        self.columns.len()
    }

    /// Names of the actions by index; empty for a box.
    #[must_use]
    pub const fn names(&self) -> &'static [&'static str] {
        match self.kind {
            ActionKind::Box => &[],
            ActionKind::Discrete { names } => names,
        }
    }

    /// True if a batch accepts a value: a finite number in a box, otherwise the index of an action or hold.
    #[must_use]
    pub fn accepts(&self, value: f32) -> bool {
        match self.kind {
            ActionKind::Box => value.is_finite(),
            ActionKind::Discrete { names } => {
                value == self.hold || (0..names.len()).any(|index| value == index as f32)
            }
        }
    }
}

impl Serialize for ActionSpace {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let kind = match self.kind {
            ActionKind::Box => "box",
            ActionKind::Discrete { .. } => "discrete",
        };
        let mut out = serializer.serialize_struct("ActionSpace", 7)?;
        out.serialize_field("kind", kind)?;
        out.serialize_field("names", self.names())?;
        out.serialize_field("columns", self.columns)?;
        out.serialize_field("low", &self.low)?;
        out.serialize_field("high", &self.high)?;
        out.serialize_field("unit", self.unit)?;
        out.serialize_field("hold", &self.hold)?;
        out.end()
    }
}

/// Axes along which actions are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Axes {
    /// The axes of the world, as in action logs.
    #[default]
    World,
    /// The own axes of each agent, in worlds that have them, for policies whose observations are along them, too. In
    /// kessler they are radial out and in-track. Values are rotated into the world's axes, rounded to single precision, and
    /// then treated like any action.
    Agent,
}

/// A finite set of actions for policies with a discrete action space.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionGrid {
    /// Axes of the actions.
    pub axes: Axes,
    /// Values of each action.
    pub rows: Vec<Vec<f32>>,
    /// Index of the action that is hold; `None` if an agent can hold only without an action.
    pub hold: Option<usize>,
    /// Description in one sentence.
    pub description: &'static str,
}

/// Range of a task's score.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ScoreRange {
    /// Lower bound of the score.
    pub min: f64,
    /// Upper bound of the score.
    pub max: f64,
}

impl ScoreRange {
    /// Share of the range by which two scores may differ and count as equal. A trainer that sums a thousand rewards in single
    /// precision is off by at most 1e-5 of the range (each addition errs by 2^-24 of the sum).
    pub const EQUAL_SHARE: f64 = 1e-4;

    /// Largest difference of two scores that count as equal.
    #[must_use]
    pub fn tolerance(&self) -> f64 {
        Self::EQUAL_SHARE * (self.max - self.min)
    }
}

/// Names of a parameter space, separated by commas.
#[must_use]
pub fn param_names(space: &[ParamSpec]) -> String {
    space.iter().map(|spec| spec.name).collect::<Vec<_>>().join(", ")
}
