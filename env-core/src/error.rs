//! Typed errors of the worlds. Each names the field at fault, the value found and the valid values. A field is a dotted
//! path; indices of lists count from 0, in paths and in messages.

use std::fmt::Display;

use crate::number_format::format_shortest;

/// An invalid scenario or recipe.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScenarioError {
    /// A field is unknown.
    #[error("{field} is not a known field; {}", if known.is_empty() { "there are none here".to_owned() } else { format!("known are {known}") })]
    UnknownField {
        /// Dotted path of the field.
        field: String,
        /// Known fields, separated by commas.
        known: String,
    },
    /// A required field is missing.
    #[error("{field} is missing: {wanted}")]
    Missing {
        /// Dotted path of the field.
        field: String,
        /// Description of a valid value.
        wanted: String,
    },
    /// A value has the wrong type.
    #[error("{field} is {found}, but must be {wanted}")]
    WrongType {
        /// Dotted path of the field.
        field: String,
        /// Value that was found.
        found: String,
        /// Description of a valid value.
        wanted: String,
    },
    /// A number is outside its bounds.
    #[error("{field} is {}, outside {} to {}", format_shortest(*value), format_shortest(*min), format_shortest(*max))]
    OutOfRange {
        /// Dotted path of the field.
        field: String,
        /// Value that was found.
        value: f64,
        /// Smallest value that is valid.
        min: f64,
        /// Largest value that is valid.
        max: f64,
    },
    /// A word is not one of the choices.
    #[error("{field} is {value:?}; choose one of {choices}")]
    UnknownChoice {
        /// Dotted path of the field.
        field: String,
        /// Word that was found.
        value: String,
        /// Valid choices, separated by commas.
        choices: String,
    },
    /// A layout contradicts the params or itself.
    #[error("{field}: {reason}")]
    Layout {
        /// Dotted path of the field.
        field: String,
        /// Description of the contradiction.
        reason: String,
    },
    /// The start is unfair: an agent is lost before it could act.
    #[error("{field}: the start is not fair: {reason}")]
    Unfair {
        /// Dotted path of the body or param at fault.
        field: String,
        /// Description of the loss.
        reason: String,
    },
}

impl ScenarioError {
    /// Checks that a number is between `min` and `max`; NaN is not.
    ///
    /// # Errors
    /// Returns [`ScenarioError::OutOfRange`] at `field` if it is not.
    pub(crate) fn check_range(field: impl Display, value: f64, min: f64, max: f64) -> Result<(), Self> {
        if value >= min && value <= max {
            Ok(())
        } else {
            Err(Self::OutOfRange { field: field.to_string(), value, min, max })
        }
    }

    /// Creates a [`ScenarioError::Layout`] error.
    pub(crate) fn layout(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Layout { field: field.into(), reason: reason.into() }
    }

    /// Dotted path of the field at fault.
    #[must_use]
    pub fn field(&self) -> &str {
        match self {
            Self::UnknownField { field, .. }
            | Self::Missing { field, .. }
            | Self::WrongType { field, .. }
            | Self::OutOfRange { field, .. }
            | Self::UnknownChoice { field, .. }
            | Self::Layout { field, .. }
            | Self::Unfair { field, .. } => field,
        }
    }

    /// Replaces the prefix `from` of the field's path by `to`, for a scenario that is part of a larger message.
    #[must_use]
    pub fn relocate(mut self, from: &str, to: &str) -> Self {
        let (Self::UnknownField { field, .. }
        | Self::Missing { field, .. }
        | Self::WrongType { field, .. }
        | Self::OutOfRange { field, .. }
        | Self::UnknownChoice { field, .. }
        | Self::Layout { field, .. }
        | Self::Unfair { field, .. }) = &mut self;
        if let Some(rest) = field.strip_prefix(from).filter(|rest| rest.is_empty() || rest.starts_with('.')) {
            *field = format!("{to}{rest}");
        }
        self
    }
}

/// An action that the environment rejects. The environment is unchanged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StepError {
    /// The episode has ended.
    #[error("the episode ended at step {step}; reset to fly another")]
    Ended {
        /// Step at which it ended.
        step: u32,
    },
    /// An entry is for an agent that does not exist.
    #[error("agent {agent} does not exist; agents are 0 to {last}")]
    UnknownAgent {
        /// Number of the agent.
        agent: u32,
        /// Largest number that is valid.
        last: u32,
    },
    /// A value is NaN or infinite.
    #[error("the action of agent {agent} is not a finite number")]
    NotFinite {
        /// Number of the agent.
        agent: u32,
    },
    /// The step has too many entries.
    #[error("{count} actions in one step; at most {max} are taken")]
    TooMany {
        /// Number of entries in the step.
        count: usize,
        /// Largest number of entries.
        max: usize,
    },
    /// The number of values does not match the action space.
    #[error("{values} values for {entries} actions; each takes {dim}")]
    Shape {
        /// Number of values in the step.
        values: usize,
        /// Number of entries in the step.
        entries: usize,
        /// Number of values of each entry.
        dim: usize,
    },
}

/// An action log that is not valid for its scenario.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LogError {
    /// The log has more steps than the episode.
    #[error("the log has {steps} steps, but the episode was over after {ended}")]
    TooLong {
        /// Number of steps in the log.
        steps: usize,
        /// Number of steps of the episode.
        ended: u32,
    },
    /// The log has fewer steps than the episode, and no stop reason.
    #[error(
        "the log has {steps} steps and the episode is not over; send every step, or say why it \
         stopped: unparsable, too_long or too_late"
    )]
    TooShort {
        /// Number of steps in the log.
        steps: usize,
    },
    /// The environment rejects a step.
    #[error("{field}: {source}")]
    Step {
        /// Path in the log: `steps.3`, or `steps.3.0` if one entry is at fault.
        field: String,
        /// Reason for the rejection.
        source: StepError,
    },
    /// The input is not a log.
    #[error("{field}: {reason}")]
    Malformed {
        /// Dotted path of the fault.
        field: String,
        /// Description of the fault.
        reason: String,
    },
}

impl LogError {
    /// Dotted path of the fault, relative to the log.
    #[must_use]
    pub fn field(&self) -> &str {
        match self {
            Self::Step { field, .. } | Self::Malformed { field, .. } => field,
            Self::TooLong { .. } | Self::TooShort { .. } => "steps",
        }
    }

    /// Prepends the path of the log itself, so that messages name the whole path.
    #[must_use]
    pub fn with_parent(mut self, parent: &str) -> Self {
        if let Self::Step { field, .. } | Self::Malformed { field, .. } = &mut self {
            *field = format!("{parent}.{field}");
        }
        self
    }

    /// Creates a [`LogError::Malformed`] error.
    pub(crate) fn malformed(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Malformed { field: field.into(), reason: reason.into() }
    }
}

/// A log that cannot be replayed on a scenario.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReplayError {
    /// The scenario cannot start.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The log is not one of this scenario.
    #[error(transparent)]
    Log(#[from] LogError),
}
