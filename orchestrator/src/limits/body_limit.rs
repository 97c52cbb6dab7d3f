//! Limit on large request bodies in memory.

use std::sync::Arc;

use tokio::sync::{Semaphore, SemaphorePermit};

use super::constants::MAX_SMALL_BODY_BYTES;

/// Limit on large request bodies: batches of results and columns. A parsed body needs many times its bytes.
///
/// Reading and parsing have separate permits. A request that waits for its body thus does not keep a received body from
/// being parsed; large bodies wait only for other large bodies.
#[derive(Debug, Clone)]
pub struct BodyLimit {
    reading: Arc<Semaphore>,
    parsing: Arc<Semaphore>,
}

/// Error of a limit that was closed because the service stops.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the service is stopping")]
pub struct LimitClosed;

impl BodyLimit {
    /// Creates a limit of `bodies` large bodies at the same time.
    #[must_use]
    pub fn new(bodies: usize) -> Self {
        Self { reading: Arc::new(Semaphore::new(bodies)), parsing: Arc::new(Semaphore::new(bodies)) }
    }

    /// Waits for the permit to read a body of `length` bytes. A small body needs none; an unknown length counts as large.
    ///
    /// # Errors
    /// Returns [`LimitClosed`] if the limit was closed.
    pub async fn acquire_read(
        &self,
        length: Option<u64>,
    ) -> Result<Option<SemaphorePermit<'_>>, LimitClosed> {
        match length {
            Some(length) if length <= MAX_SMALL_BODY_BYTES => Ok(None),
            _ => self.reading.acquire().await.map(Some).map_err(|_| LimitClosed),
        }
    }

    /// Waits for the permit to parse a body, to be held as long as the parsed content exists.
    ///
    /// # Errors
    /// Returns [`LimitClosed`] if the limit was closed.
    pub async fn acquire_parse(&self) -> Result<SemaphorePermit<'_>, LimitClosed> {
        self.parsing.acquire().await.map_err(|_| LimitClosed)
    }
}
