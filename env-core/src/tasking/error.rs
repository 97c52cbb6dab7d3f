//! Errors of the tasking world.

/// A set-up, an action or a recording that is not valid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TaskingError {
    /// An epoch is not a UTC text.
    #[error(
        "`{text}` is not an epoch such as `2004 MAY 17 05:21:09.359 (UTC)` or `2004-05-17T05:21:09.359` of the years 1972 to 2099"
    )]
    Epoch {
        /// Start of the text.
        text: String,
    },
    /// An argument is not known.
    #[error("`{name}` is not an argument of the {models}; known are {known}")]
    UnknownArgument {
        /// Name of the argument.
        name: String,
        /// Models whose arguments are set.
        models: String,
        /// Names of all arguments.
        known: String,
    },
    /// An argument has an invalid value.
    #[error("`{name}` {requirement}, got {value}")]
    InvalidArgument {
        /// Name of the argument, with the satellite's before it where there are several.
        name: String,
        /// Condition that the value must meet, such as `must be greater than 0`.
        requirement: String,
        /// The value as text.
        value: String,
    },
    /// Parts of a set-up do not fit together.
    #[error("{0}")]
    Composition(String),
    /// A part of BSK-RL that this world does not have.
    #[error("{0} is not supported by this version of the tasking world")]
    NotSupported(String),
    /// An action is not one of the satellite's.
    #[error("action of satellite {satellite}: {reason}")]
    Action {
        /// Name of the satellite.
        satellite: String,
        /// Reason why it is not valid, and the valid actions.
        reason: String,
    },
    /// Nothing would end a step.
    #[error(
        "no event ends this step: give a satellite an action with a duration, or set max_step_duration or time_limit"
    )]
    EndlessStep,
    /// The motion of a satellite is no longer finite.
    #[error(
        "the attitude of satellite {satellite} diverged: its control is unstable at this sim_rate; shorten the ticks, or lower its gains \
         or u_max"
    )]
    Diverged {
        /// Name of the satellite.
        satellite: String,
    },
    /// A satellite has no upcoming opportunity of the required types.
    #[error(
        "satellite {satellite} has no upcoming opportunity of type {types}; add targets, lower the minimum elevation, or extend \
         the time that is searched"
    )]
    NoOpportunity {
        /// Name of the satellite.
        satellite: String,
        /// Types of opportunities that were searched.
        types: String,
    },
}

impl TaskingError {
    /// Error of an argument with an invalid value.
    pub(crate) fn invalid(name: &str, requirement: &str, value: impl std::fmt::Display) -> Self {
        Self::InvalidArgument {
            name: name.to_owned(),
            requirement: requirement.to_owned(),
            value: value.to_string(),
        }
    }
}
