//! [`FieldError`]: a problem of one field of a design.

/// Problem of one field of a design, as a sentence that the designer can act on.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {message}")]
pub struct FieldError {
    /// Path of the field, such as `encounters.0.step`.
    pub field: String,
    /// Problem of the field, and which values are allowed.
    pub message: String,
}

impl FieldError {
    /// Creates an error of a field.
    pub(crate) fn new(field: impl Into<String>, message: impl Into<String>) -> Self {
        Self { field: field.into(), message: message.into() }
    }
}
