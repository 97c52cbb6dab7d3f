//! Check whether the database accepts writes, without waiting for the writer.

use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use tokio::sync::watch;

use crate::engine::error::ServiceError;
use crate::engine::write_probe::WriteProbe;
use crate::engine::writer::Writer;

/// Time for which a result is cached. Every client may ask for it, and each check writes a row.
const CACHE_TTL: Duration = Duration::from_secs(1);
/// Longest time that a request waits for a check. After that the last result counts.
const MAX_WAIT: Duration = Duration::from_millis(500);
/// Duration of a check after which the writer counts as stuck.
const STUCK_AFTER: Duration = Duration::from_secs(15);

/// Check whether the database accepts writes, with a cached result. Clones share the cache.
#[derive(Debug, Clone, Default)]
pub struct ReadinessProbe {
    check: Arc<Mutex<Check>>,
}

/// State of the check.
#[derive(Debug, Default)]
struct Check {
    /// When the last check began.
    begun_at: Option<Instant>,
    /// Changes when the check that runs has ended.
    running: Option<watch::Receiver<bool>>,
    /// Reason why the last check failed.
    failure: Option<String>,
}

impl ReadinessProbe {
    /// Returns whether the database can be written. Begins a check by a write, unless a recent result is known.
    ///
    /// # Errors
    /// Returns a sentence with the reason if the database cannot be written.
    pub(super) async fn check_writable(&self, writer: &Writer) -> Result<(), String> {
        // While an outage lasts, the writer itself checks the database.
        if writer.health().outage().is_none()
            && let Some(mut running) = self.begin(writer)
        {
            // A check that takes longer is examined below.
            let _ = tokio::time::timeout(MAX_WAIT, running.wait_for(|ended| *ended)).await;
        }
        if let Some(reason) = writer.health().reason() {
            return Err(reason);
        }
        let check = self.check.lock();
        let age = check.begun_at.map_or(Duration::ZERO, |at| at.elapsed());
        if check.running.is_some() && age > STUCK_AFTER {
            let seconds = age.as_secs();
            return Err(format!(
                "The writer has not stored a change for {seconds} s; check the disk and the load."
            ));
        }
        check.failure.clone().map_or(Ok(()), Err)
    }

    /// Begins a check, unless the last one is recent. Returns the check that runs.
    fn begin(&self, writer: &Writer) -> Option<watch::Receiver<bool>> {
        let mut check = self.check.lock();
        if check.running.is_some() || check.begun_at.is_some_and(|at| at.elapsed() < CACHE_TTL) {
            return check.running.clone();
        }
        let (ended, running) = watch::channel(false);
        check.begun_at = Some(Instant::now());
        check.running = Some(running.clone());
        let (shared, writer) = (Arc::clone(&self.check), writer.clone());
        tokio::spawn(async move {
            let written = writer.change(WriteProbe).await;
            let mut check = shared.lock();
            check.failure = written.err().map(|error| failure_reason(&error));
            check.running = None;
            ended.send_replace(true);
        });
        Some(running)
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
