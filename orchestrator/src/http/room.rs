//! Room for large bodies: how many are read and parsed at a time, and where.

use std::sync::Arc;

use axum::extract::{FromRequest, Request};
use axum::http::header;
use tokio::sync::{Semaphore, SemaphorePermit};

use super::extract::{BODY, Bytes};
use super::problem::Problem;
use crate::engine::error::ServiceError;

/// Bytes up to which a body is read beside any number of others.
const SMALL: u64 = 1 << 20;

/// Room for the bodies of trainers: what is read into a log or a column is many times its bytes, and memory has a bound.
///
/// Nobody waits for a body that has not come yet, but large ones for large ones.
#[derive(Debug, Clone)]
pub struct Room {
    reading: Arc<Semaphore>,
    parsing: Arc<Semaphore>,
}

impl Room {
    /// For so many large bodies at a time.
    pub(crate) fn new(bodies: usize) -> Self {
        Self { reading: Arc::new(Semaphore::new(bodies)), parsing: Arc::new(Semaphore::new(bodies)) }
    }

    /// A body, once there is room for what is made of it: as long as the permit is held.
    pub(super) async fn body(&self, request: Request) -> Result<(Bytes, SemaphorePermit<'_>), Problem> {
        let length = request.headers().get(header::CONTENT_LENGTH);
        let length = length.and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
        let stopping = |_| Problem::from(ServiceError::Stopping);
        let _large = match length {
            Some(length) if length <= SMALL => None,
            _ => Some(self.reading.acquire().await.map_err(stopping)?),
        };
        let body = Bytes::from_request(request, &()).await?;
        Ok((body, self.parsing.acquire().await.map_err(stopping)?))
    }
}

/// Does what takes milliseconds beside the threads that answer: whoever waits for a lease needs those.
pub(super) async fn aside<T, F>(work: F) -> Result<T, Problem>
where
    T: Send + 'static,
    F: FnOnce() -> Result<T, Problem> + Send + 'static,
{
    let done = tokio::task::spawn_blocking(work).await;
    done.map_err(|error| Problem::from(ServiceError::invalid(BODY, error.to_string())))?
}
