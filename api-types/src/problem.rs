//! Problem details of an error response (RFC 9457).

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Problem details of a failed request (RFC 9457).
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(default)]
#[schema(as = Problem)]
pub struct ProblemDetails {
    /// URN of the kind of problem.
    #[serde(rename = "type")]
    #[schema(required = true, example = "urn:sparring:problem:invalid")]
    pub kind: String,
    /// Reason phrase of the HTTP status.
    #[schema(required = true)]
    pub title: String,
    /// HTTP status of the response.
    #[schema(required = true)]
    pub status: u16,
    /// Sentence that describes this occurrence.
    #[schema(required = true)]
    pub detail: String,
    /// Field that caused the problem, as a dotted path.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub field: Option<String>,
}

impl ProblemDetails {
    /// Code of the kind of problem, the last part of its URN.
    #[must_use]
    pub fn code(&self) -> &str {
        self.kind.rsplit(':').next().unwrap_or_default()
    }

    /// Cause of the problem, without the field that caused it.
    #[must_use]
    pub fn message(&self) -> &str {
        let texts = [self.detail.as_str(), self.title.as_str()];
        texts.into_iter().find(|text| !text.is_empty()).unwrap_or("the service does not say why")
    }

    /// Cause of the problem, after the field that caused it if there is one.
    #[must_use]
    pub fn message_with_field(&self) -> String {
        match &self.field {
            Some(field) => format!("{field}: {}", self.message()),
            None => self.message().to_owned(),
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
        assert_eq!((problem.code(), problem.status), ("x", 422));
        assert_eq!(problem.message_with_field(), "groups: it is 0");
        assert_eq!(ProblemDetails::default().message_with_field(), "the service does not say why");
    }
}
