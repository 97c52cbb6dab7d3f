//! Blocking work of request handlers.

use super::extract::BODY;
use super::problem::Problem;
use crate::engine::error::ServiceError;

/// Runs work of milliseconds on a blocking thread, so that the threads that answer requests for leases stay free.
pub(super) async fn run_blocking<T, F>(work: F) -> Result<T, Problem>
where
    T: Send + 'static,
    F: FnOnce() -> Result<T, Problem> + Send + 'static,
{
    let result = tokio::task::spawn_blocking(work).await;
    result.map_err(|error| Problem::from(ServiceError::invalid(BODY, error.to_string())))?
}
