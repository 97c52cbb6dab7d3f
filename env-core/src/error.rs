//! Typed errors of the worlds. Each names the field at fault, the value found and the valid values. A field is a dotted
//! path; indices of lists count from 0, in paths and in messages.

use std::fmt::{self, Display};

use crate::number_format::format_shortest;

/// An invalid scenario or recipe.
#[derive(Debug, Clone, PartialEq)]
pub enum ScenarioError {
    /// A field is unknown.
    UnknownField {
        /// Dotted path of the field.
        field: String,
        /// Known fields, separated by commas.
        known: String,
    },
    /// A required field is missing.
    Missing {
        /// Dotted path of the field.
        field: String,
        /// Description of a valid value.
        wanted: String,
    },
    /// A value has the wrong type.
    WrongType {
        /// Dotted path of the field.
        field: String,
        /// Value that was found.
        found: String,
        /// Description of a valid value.
        wanted: String,
    },
    /// A number is outside its bounds.
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
    UnknownChoice {
        /// Dotted path of the field.
        field: String,
        /// Word that was found.
        value: String,
        /// Valid choices, separated by commas.
        choices: String,
    },
    /// A layout contradicts the params or itself.
    Layout {
        /// Dotted path of the field.
        field: String,
        /// Description of the contradiction, as a sentence without its subject.
        reason: String,
    },
    /// The start is unfair: an agent is lost before it could act.
    Unfair {
        /// Dotted path of the body or param at fault.
        field: String,
        /// Description of the loss.
        reason: String,
    },
}

impl fmt::Display for ScenarioError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.field(), self.reason())
    }
}

impl std::error::Error for ScenarioError {}

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

    /// Reason of the error, as a sentence without its subject, the field.
    #[must_use]
    pub fn reason(&self) -> String {
        match self {
            Self::UnknownField { known, .. } if known.is_empty() => {
                "is not a known field; this object has no fields".to_owned()
            }
            Self::UnknownField { known, .. } => format!("is not a known field; the known fields are {known}"),
            Self::Missing { wanted, .. } => format!("is required: {wanted}"),
            Self::WrongType { found, wanted, .. } => format!("must be {wanted}, got {found}"),
            Self::OutOfRange { value, min, max, .. } => {
                let [value, min, max] = [value, min, max].map(|number| format_shortest(*number));
                format!("must be from {min} to {max}, got {value}")
            }
            Self::UnknownChoice { value, choices, .. } => format!("must be one of {choices}, got {value:?}"),
            Self::Layout { reason, .. } => reason.clone(),
            Self::Unfair { reason, .. } => format!("makes the start unfair: {reason}"),
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
    #[error("the episode ended at step {step}; reset to start another")]
    Ended {
        /// Step at which it ended.
        step: u32,
    },
    /// An entry is for an agent that does not exist.
    #[error("the agent must be from 0 to {last}, got {agent}")]
    UnknownAgent {
        /// Number of the agent.
        agent: u32,
        /// Largest number that is valid.
        last: u32,
    },
    /// A value is NaN or infinite.
    #[error("the action of agent {agent} must be finite")]
    NotFinite {
        /// Number of the agent.
        agent: u32,
    },
    /// A value is not the index of an action.
    #[error("the action of agent {agent} must be a whole number from 0 to {last}, got {}", format_shortest(*value))]
    UnknownAction {
        /// Number of the agent.
        agent: u32,
        /// Value of the entry.
        value: f64,
        /// Largest index of an action.
        last: usize,
    },
    /// The step has too many entries.
    #[error("a step must have at most {max} actions, got {count}")]
    TooMany {
        /// Number of entries in the step.
        count: usize,
        /// Largest number of entries.
        max: usize,
    },
    /// The number of values does not match the action space.
    #[error("each action must have {dim} values, got {values} values for {entries} actions")]
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
        "the log has {steps} steps, but the episode is not over; send every step, or set `stopped` to unparsable, \
         too_long or too_late"
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

    /// Reason of the error, without the field.
    #[must_use]
    pub fn reason(&self) -> String {
        match self {
            Self::Step { source, .. } => source.to_string(),
            Self::Malformed { reason, .. } => reason.clone(),
            Self::TooLong { .. } | Self::TooShort { .. } => self.to_string(),
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

/// A policy that cannot be created, or cannot act.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PolicyError {
    /// The task has no policy with this name.
    #[error("the policy must be one of {known}, got {name:?}")]
    Unknown {
        /// Name that was requested.
        name: String,
        /// Known names, separated by commas.
        known: String,
    },
    /// The scenario cannot start.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The policy is not one for the task.
    #[error("the policy {name} cannot act in {task}: {reason}")]
    Task {
        /// Name of the policy.
        name: String,
        /// Id of the task.
        task: &'static str,
        /// Reason why it cannot act there, as a clause.
        reason: String,
    },
    /// The policy has no action for an observation.
    #[error("the policy {name} has no action: {reason}")]
    Act {
        /// Name of the policy.
        name: String,
        /// Reason why it has none, as a clause.
        reason: String,
    },
}

/// An episode that cannot be run on a scenario, by a log or a policy.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReplayError {
    /// The scenario cannot start.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The log is not one of this scenario.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The policy has no action.
    #[error(transparent)]
    Policy(#[from] PolicyError),
}
