//! Deletes the rows of deleted runs, in the background.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::Notify;

use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::retention::delete_run_rows::{DeleteRunRows, RowDeletion};
use crate::workers::round_error::ends_worker;

/// Pause after an error, and maximum wait for a signal, in case one was missed.
const PAUSE: Duration = Duration::from_secs(5);

/// Runs until the writer stops. The first round continues what the last server left.
pub async fn run(writer: Writer, wake: Arc<Notify>) {
    loop {
        match delete_pending(&writer).await {
            Ok(()) => {
                let _ = tokio::time::timeout(PAUSE, wake.notified()).await;
            }
            Err(error) if ends_worker(&error, "the rows of a deleted run could not be deleted") => return,
            Err(_) => tokio::time::sleep(PAUSE).await,
        }
    }
}

/// Deletes all rows of all deleted runs.
///
/// # Errors
/// Returns the error of the first change that failed. Another call continues.
pub async fn delete_pending(writer: &Writer) -> Result<(), ServiceError> {
    loop {
        match writer.change(DeleteRunRows).await? {
            RowDeletion::Nothing => return Ok(()),
            RowDeletion::Unfinished => {}
            RowDeletion::Finished(run) => tracing::info!(run, "All data of a deleted run is gone."),
        }
    }
}
