//! Declaration of one hyperparameter: its name, range, default and source.

use env_core::text::{MAX_QUOTED_CHARS, shorten};
use serde_json::Value;

/// Hyperparameter of a strategy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hyperparameter {
    /// Name of the entry in `strategy_settings`.
    pub name: &'static str,
    /// Values it accepts, and its default.
    pub range: ValueRange,
    /// Effect of the hyperparameter.
    pub description: &'static str,
    /// Source of the default.
    pub source: &'static str,
}

/// Values that a hyperparameter accepts, and its default.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ValueRange {
    /// Real number within bounds.
    Number {
        /// Value if none is given.
        default: f64,
        /// Smallest value that is accepted.
        min: f64,
        /// Largest value that is accepted.
        max: f64,
    },
    /// Whole number within bounds.
    Whole {
        /// Value if none is given.
        default: u32,
        /// Smallest value that is accepted.
        min: u32,
        /// Largest value that is accepted.
        max: u32,
    },
    /// One of several names; the first is the default.
    Choice(&'static [&'static str]),
}

impl ValueRange {
    /// Largest whole number that is accepted; 0 for other ranges.
    pub(crate) const fn max_whole(self) -> u32 {
        match self {
            Self::Whole { max, .. } => max,
            Self::Number { .. } | Self::Choice(_) => 0,
        }
    }

    /// Default as a number: a choice is its index.
    pub(crate) fn default(self) -> f64 {
        match self {
            Self::Number { default, .. } => default,
            Self::Whole { default, .. } => f64::from(default),
            Self::Choice(_) => 0.0,
        }
    }

    /// Parses a JSON value into a number: a choice becomes its index.
    ///
    /// # Errors
    /// Returns the end of a sentence ("must be …, got 2") if the value is of another type or outside the range.
    pub(crate) fn parse(self, value: &Value) -> Result<f64, String> {
        let wanted = self.expectation();
        let shown = shorten(&value.to_string(), MAX_QUOTED_CHARS);
        let wrong = || format!("must be {wanted}, got {shown}");
        match self {
            Self::Number { min, max, .. } => {
                value.as_f64().filter(|number| (min..=max).contains(number)).ok_or_else(wrong)
            }
            Self::Whole { min, max, .. } => {
                let whole = value.as_u64().and_then(|number| u32::try_from(number).ok());
                whole.filter(|number| (min..=max).contains(number)).map(f64::from).ok_or_else(wrong)
            }
            Self::Choice(choices) => {
                let index = choices.iter().position(|choice| value.as_str() == Some(choice));
                index.and_then(|index| u32::try_from(index).ok()).map(f64::from).ok_or_else(wrong)
            }
        }
    }

    /// Accepted values in words, as the end of a sentence: "a number from 0 to 1".
    #[must_use]
    pub fn expectation(self) -> String {
        match self {
            Self::Number { min, max, .. } => format!("a number from {min} to {max}"),
            Self::Whole { min, max, .. } => format!("an integer from {min} to {max}"),
            Self::Choice(choices) => format!("one of {}", choices.join(", ")),
        }
    }

    /// Converts a number into its JSON form: the index of a choice becomes its name.
    #[must_use]
    pub fn to_json(self, value: f64) -> Value {
        match self {
            Self::Number { .. } => Value::from(value),
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "the value was parsed from a u32"
            )]
            Self::Whole { .. } => Value::from(value as u32),
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "the value is an index into the choices"
            )]
            Self::Choice(choices) => Value::from(choices.get(value as usize).copied().unwrap_or_default()),
        }
    }

    /// Default in its JSON form.
    #[must_use]
    pub fn default_json(self) -> Value {
        self.to_json(self.default())
    }
}
