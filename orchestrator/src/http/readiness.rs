//! Check whether the database accepts writes.

use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::Mutex;

use crate::engine::error::ServiceError;
use crate::engine::write_probe::WriteProbe;
use crate::engine::writer::Writer;

/// Time for which a result is cached. Every client may ask for it, and each check writes a row.
const CACHE_TTL: Duration = Duration::from_secs(1);

/// Check whether the database accepts writes, with a cached result. Clones share the cache.
#[derive(Debug, Clone, Default)]
pub struct ReadinessProbe {
    last: Arc<Mutex<Option<ProbeResult>>>,
}

/// Result of a check.
#[derive(Debug)]
struct ProbeResult {
    at: Instant,
    writable: Result<(), String>,
}

impl ReadinessProbe {
    /// Writes a row, unless the cached result is recent.
    ///
    /// # Errors
    /// Returns a sentence with the reason if the database cannot be written.
    pub(super) async fn check_writable(&self, writer: &Writer) -> Result<(), String> {
        let mut last = self.last.lock().await;
        let result = match last.take().filter(|result| result.at.elapsed() < CACHE_TTL) {
            Some(result) => result,
            None => {
                let written = writer.change(WriteProbe).await;
                let writable = written.map_err(|error| failure_reason(&error));
                ProbeResult { at: Instant::now(), writable }
            }
        };
        last.insert(result).writable.clone()
    }
}

/// Describes why the database cannot be written. The text of a database error goes only to the log.
fn failure_reason(error: &ServiceError) -> String {
    tracing::warn!(error = %error, "The server is not ready.");
    let reason = match (error, error.outage()) {
        (_, Some(outage)) => outage.to_string(),
        (ServiceError::Busy | ServiceError::Stopping, _) => error.to_string(),
        _ => "the server's log has the reason".to_owned(),
    };
    format!("The database cannot be written: {reason}.")
}
