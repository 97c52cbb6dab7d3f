//! Typed errors of the worlds. Each names the field at fault, what was found and what would be right. A field is a dotted
//! path, and places in lists count from 0, in the path and in the words alike.

use crate::told;

/// A scenario (or recipe) that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScenarioError {
    /// A field nobody knows.
    #[error("{field} is not a known field; {}", if known.is_empty() { "there are none here".to_owned() } else { format!("known are {known}") })]
    UnknownField {
        /// Where it stands, as a dotted path.
        field: String,
        /// What could have stood there.
        known: String,
    },
    /// A field that must be there and is not.
    #[error("{field} is missing: {wanted}")]
    Missing {
        /// Where it should stand.
        field: String,
        /// What is wanted.
        wanted: String,
    },
    /// A value of the wrong kind.
    #[error("{field} is {found}, but must be {wanted}")]
    WrongType {
        /// Where it stands.
        field: String,
        /// What was found.
        found: String,
        /// What is wanted.
        wanted: String,
    },
    /// A number outside its bounds.
    #[error("{field} is {}, outside {} to {}", told(*value), told(*min), told(*max))]
    OutOfRange {
        /// Where it stands.
        field: String,
        /// The value found.
        value: f64,
        /// Smallest allowed.
        min: f64,
        /// Largest allowed.
        max: f64,
    },
    /// A word that is none of the choices.
    #[error("{field} is {value:?}; choose one of {choices}")]
    UnknownChoice {
        /// Where it stands.
        field: String,
        /// The word found.
        value: String,
        /// The words that are known.
        choices: String,
    },
    /// A layout that contradicts the params or itself.
    #[error("{field}: {reason}")]
    Layout {
        /// Where it stands.
        field: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A start in which something is lost before anybody could act.
    #[error("{field}: the start is not fair: {reason}")]
    Unfair {
        /// Which body is at fault.
        field: String,
        /// What happens.
        reason: String,
    },
}

impl ScenarioError {
    /// The dotted path of the field at fault.
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

    /// The same, where what is called `from` in a scenario stands at `to` in what was sent.
    #[must_use]
    pub fn moved(mut self, from: &str, to: &str) -> Self {
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

/// An action the environment does not take. The environment is unchanged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StepError {
    /// The episode is over.
    #[error("the episode ended at step {step}; reset to fly another")]
    Ended {
        /// The step at which it ended.
        step: u32,
    },
    /// An action for an agent that does not exist.
    #[error("agent {agent} does not exist; agents are 0 to {last}")]
    UnknownAgent {
        /// The id found.
        agent: u32,
        /// The last id that exists.
        last: u32,
    },
    /// NaN or an infinity.
    #[error("the action of agent {agent} is not a finite number")]
    NotFinite {
        /// Whose action.
        agent: u32,
    },
    /// More entries in one step than any agent needs.
    #[error("{count} actions in one step; at most {max} are taken")]
    TooMany {
        /// How many were given.
        count: usize,
        /// How many are taken.
        max: usize,
    },
    /// Values do not match the action space.
    #[error("{values} values for {entries} actions; each takes {dim}")]
    Shape {
        /// How many values were given.
        values: usize,
        /// For how many actions.
        entries: usize,
        /// How many each takes.
        dim: usize,
    },
}

/// An action log that is not the log of an episode of its scenario.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LogError {
    /// More steps than the episode has.
    #[error("the log has {steps} steps, but the episode was over after {ended}")]
    TooLong {
        /// Steps in the log.
        steps: usize,
        /// Steps the episode had.
        ended: u32,
    },
    /// Fewer steps than the episode has, and no word why.
    #[error(
        "the log has {steps} steps and the episode is not over; send every step, or say why it \
         stopped: unparsable, too_long or too_late"
    )]
    TooShort {
        /// Steps in the log.
        steps: usize,
    },
    /// A step the environment refuses.
    #[error("{field}: {source}")]
    Step {
        /// Where it stands in the log: `steps.3`, or `steps.3.0` where one entry is at fault.
        field: String,
        /// Why.
        source: StepError,
    },
    /// Something that is not a log.
    #[error("{field}: {reason}")]
    Malformed {
        /// Where.
        field: String,
        /// What is wrong.
        reason: String,
    },
}

impl LogError {
    /// The dotted path of what is at fault, from the log on.
    #[must_use]
    pub fn field(&self) -> &str {
        match self {
            Self::Step { field, .. } | Self::Malformed { field, .. } => field,
            Self::TooLong { .. } | Self::TooShort { .. } => "steps",
        }
    }

    /// The same of a log that stands under `parent`, so that the words name the whole path.
    #[must_use]
    pub fn under(mut self, parent: &str) -> Self {
        if let Self::Step { field, .. } | Self::Malformed { field, .. } = &mut self {
            *field = format!("{parent}.{field}");
        }
        self
    }

    /// A malformed log, by place and reason.
    pub(crate) fn malformed(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Malformed { field: field.into(), reason: reason.into() }
    }
}
