//! Checkpoints the write-ahead log, so that neither the writer nor its callers wait for it.

use std::sync::Arc;
use std::time::Duration;

use sqlx::{Connection, SqliteConnection};
use store::{DatabaseLock, FileState};
use tokio::sync::watch;

/// Interval between two checkpoints.
const CHECKPOINT_INTERVAL: Duration = Duration::from_millis(500);

/// Runs until the server stops, then closes its connection: the last connection to close checkpoints the rest.
///
/// After a file was replaced or truncated, it waits until the writer has examined the files: a checkpoint would copy missing pages.
pub async fn run(
    mut connection: SqliteConnection,
    files: Arc<DatabaseLock>,
    mut stopped: watch::Receiver<bool>,
) {
    let mut is_failing = false;
    while tokio::time::timeout(CHECKPOINT_INTERVAL, stopped.wait_for(|stop| *stop)).await.is_err() {
        if files.file_state() != FileState::Intact {
            continue;
        }
        match store::checkpoint(&mut connection).await {
            Err(error) if !is_failing => {
                is_failing = true; // logged once, although every checkpoint may fail
                tracing::warn!(error = %error, "The write-ahead log could not be checkpointed; the server retries.");
            }
            Err(_) => {}
            Ok(()) if is_failing => {
                is_failing = false;
                tracing::info!("The write-ahead log was checkpointed again.");
            }
            Ok(()) => {}
        }
    }
    if let Err(error) = connection.close().await {
        tracing::warn!(error = %error, "A connection to the database did not close cleanly.");
    }
}
