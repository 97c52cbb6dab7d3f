//! Problem details of an error response (RFC 9457), as clients read them.

use serde::{Deserialize, Serialize};

/// Error response, reduced to the fields that people read.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ProblemDetails {
    /// Kind of the problem.
    pub title: Option<String>,
    /// Cause of this problem, in one sentence.
    pub detail: Option<String>,
    /// Path of the field at fault, with dots between its parts.
    pub field: Option<String>,
}

impl ProblemDetails {
    /// Cause of the problem, without the field at fault.
    #[must_use]
    pub fn message(self) -> String {
        self.detail.or(self.title).unwrap_or_else(|| "the service does not say why".to_owned())
    }

    /// Cause of the problem, after the field at fault if there is one.
    #[must_use]
    pub fn message_with_field(mut self) -> String {
        match self.field.take() {
            Some(field) => format!("{field}: {}", self.message()),
            None => self.message(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn message_names_the_field_at_fault() {
        let problem: ProblemDetails = serde_json::from_str(
            r#"{"type": "urn:x", "title": "Unprocessable", "status": 422, "detail": "it is 0", "field": "groups"}"#,
        )
        .expect("problem details");
        assert_eq!(problem.message_with_field(), "groups: it is 0");
        assert_eq!(ProblemDetails::default().message_with_field(), "the service does not say why");
    }
}
