//! Messages of failed use cases for protocols without problem details.

use super::super::problem::Problem;
use crate::engine::error::ServiceError;
use crate::sessions::SessionError;

/// Returns the message of a failed use case, without what only the log may contain.
pub(super) fn service_error_message(error: &ServiceError) -> String {
    match error {
        ServiceError::Restore(_) | ServiceError::Store(_) | ServiceError::NotCommitted { .. } => {
            tracing::error!(error = %error, "A session's request failed.");
            Problem::internal().message()
        }
        other => other.to_string(),
    }
}

/// Returns the message of a session's error.
pub(super) fn session_error_message(error: &SessionError) -> String {
    match error {
        SessionError::Service(failure) => service_error_message(failure),
        other => other.to_string(),
    }
}
