//! Values of arguments, read by name.

use std::collections::BTreeMap;
use std::fmt;

use crate::tasking::error::TaskingError;
use crate::tasking::orbit::OrbitalElements;

/// Value of an argument.
#[derive(Debug, Clone, PartialEq)]
pub enum ArgValue {
    /// No value (Python's `None`).
    None,
    /// True or false, as a flag.
    Flag(bool),
    /// A number; infinite ones are allowed.
    Number(f64),
    /// A text without a meaning here.
    Text(String),
    /// A list of numbers.
    Numbers(Vec<f64>),
    /// Elements of an elliptic orbit.
    Elements(OrbitalElements),
    /// A list of texts.
    Texts(Vec<String>),
}

/// Writes the value as in Python; elements of an orbit as a sentence.
impl fmt::Display for ArgValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("None"),
            Self::Flag(true) => f.write_str("True"),
            Self::Flag(false) => f.write_str("False"),
            Self::Number(value) => write!(f, "{value}"),
            Self::Text(text) => write!(f, "{text:?}"),
            Self::Numbers(values) => write!(f, "{values:?}"),
            Self::Texts(texts) => write!(f, "{texts:?}"),
            Self::Elements(orbit) => {
                write!(f, "an orbit with a = {} m and e = {}", orbit.semi_major_axis_m, orbit.eccentricity)
            }
        }
    }
}

/// Reads arguments by their names.
#[derive(Debug)]
pub struct ArgReader {
    values: BTreeMap<String, ArgValue>,
}

impl ArgReader {
    /// Takes the values of arguments.
    ///
    /// # Errors
    /// Returns [`TaskingError::UnknownArgument`] if a name is not one of the known ones. `models` names their owner.
    pub fn new<'a>(
        values: impl IntoIterator<Item = (&'a str, ArgValue)>,
        known: &[&str],
        models: &str,
    ) -> Result<Self, TaskingError> {
        let mut taken = BTreeMap::new();
        for (name, value) in values {
            if !known.contains(&name) {
                let mut known = known.to_vec();
                known.sort_unstable();
                return Err(TaskingError::UnknownArgument {
                    name: name.to_owned(),
                    models: models.to_owned(),
                    known: known.join(", "),
                });
            }
            taken.insert(name.to_owned(), value);
        }
        Ok(Self { values: taken })
    }

    /// True if an argument has a value, `None` included.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.values.contains_key(name)
    }

    /// Accepts arguments that have no effect here.
    pub fn ignore(&mut self, names: &[&str]) {
        for name in names {
            self.values.remove(*name);
        }
    }

    fn get(&self, name: &str) -> &ArgValue {
        self.values.get(name).unwrap_or(&ArgValue::None)
    }

    /// Reads a number, if there is one.
    ///
    /// # Errors
    /// Returns [`TaskingError::InvalidArgument`] if the value is NaN or not a number.
    pub fn number(&self, name: &str, target: &mut f64) -> Result<(), TaskingError> {
        match self.get(name) {
            ArgValue::None => Ok(()),
            ArgValue::Number(value) if !value.is_nan() => {
                *target = *value;
                Ok(())
            }
            other => Err(TaskingError::invalid(name, "must be a number", other.to_string())),
        }
    }

    /// Reads a number or `None`.
    ///
    /// # Errors
    /// Returns [`TaskingError::InvalidArgument`] if the value is NaN or neither.
    pub fn optional_number(&self, name: &str, target: &mut Option<f64>) -> Result<(), TaskingError> {
        if self.has(name) {
            let mut value = f64::NAN;
            self.number(name, &mut value)?;
            *target = (!value.is_nan()).then_some(value);
        }
        Ok(())
    }

    /// Reads three finite numbers, if there are any.
    ///
    /// # Errors
    /// Returns [`TaskingError::InvalidArgument`] if the value is not a list of three finite numbers.
    pub fn vector(&self, name: &str, target: &mut [f64; 3]) -> Result<(), TaskingError> {
        self.numbers(name, target)
    }

    /// Reads `N` finite numbers, if there are any.
    ///
    /// # Errors
    /// Returns [`TaskingError::InvalidArgument`] if the value is not a list of `N` finite numbers.
    pub fn numbers<const N: usize>(&self, name: &str, target: &mut [f64; N]) -> Result<(), TaskingError> {
        match self.get(name) {
            ArgValue::None => Ok(()),
            ArgValue::Numbers(values) if values.len() == N && values.iter().all(|x| x.is_finite()) => {
                target.copy_from_slice(values);
                Ok(())
            }
            other => {
                let requirement = format!("must be a list of {N} finite numbers");
                Err(TaskingError::invalid(name, &requirement, other.to_string()))
            }
        }
    }

    /// Reads a text; `None` if there is none.
    ///
    /// # Errors
    /// Returns [`TaskingError::InvalidArgument`] if the value is not a text.
    pub fn text(&self, name: &str) -> Result<Option<String>, TaskingError> {
        match self.get(name) {
            ArgValue::None => Ok(None),
            ArgValue::Text(text) => Ok(Some(text.clone())),
            other => Err(TaskingError::invalid(name, "must be a text or None", other.to_string())),
        }
    }

    /// Reads a truth value, if there is one.
    ///
    /// # Errors
    /// Returns [`TaskingError::InvalidArgument`] if the value is not a truth value.
    pub fn flag(&self, name: &str, target: &mut bool) -> Result<(), TaskingError> {
        match self.get(name) {
            ArgValue::None => Ok(()),
            ArgValue::Flag(value) => {
                *target = *value;
                Ok(())
            }
            other => Err(TaskingError::invalid(name, "must be true or false", other.to_string())),
        }
    }

    /// Reads orbital elements, if there are any.
    ///
    /// # Errors
    /// Returns [`TaskingError::InvalidArgument`] if the value is not an elliptic orbit.
    pub fn elements(&self, name: &str) -> Result<Option<OrbitalElements>, TaskingError> {
        match self.get(name) {
            ArgValue::None => Ok(None),
            ArgValue::Elements(elements) if (0.0..1.0).contains(&elements.eccentricity) => {
                Ok(Some(*elements))
            }
            other => {
                let requirement = "must be orbital elements with an eccentricity from 0 to less than 1";
                Err(TaskingError::invalid(name, requirement, other.to_string()))
            }
        }
    }
}
