//! Reaction of workers to an error in a round.

use crate::engine::error::ServiceError;

/// True if a worker must end, because the writer stops. Any other error is temporary: the worker tries again after a pause.
///
/// A full queue of changes is not logged: the clients that fill it come first. An outage of the database is logged by the writer. `failure` is the sentence that is logged for other
/// errors, such as `leases could not be expired`.
pub(super) fn ends_worker(error: &ServiceError, failure: &'static str) -> bool {
    match error {
        ServiceError::Stopping => true,
        ServiceError::Busy => false,
        error if error.outage().is_some() => {
            tracing::debug!(error = %error, "{failure}; the server retries");
            false
        }
        error => {
            tracing::error!(error = %error, "{failure}; the server retries");
            false
        }
    }
}
