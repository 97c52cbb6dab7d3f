//! Ends leases whose time is over.

use std::time::Duration;

use crate::training::lease::Expire;
use crate::training::{TrainingError, Writer};

/// How often it looks.
const EVERY: Duration = Duration::from_millis(500);

/// Works until the writer is gone.
pub async fn run(writer: Writer) {
    loop {
        match writer.change(Expire).await {
            Ok(0) => {}
            Ok(ended) => {
                tracing::info!(ended, "Leases expired; what was not reported is offered again.");
                continue; // there may be more
            }
            Err(TrainingError::Stopping) => return,
            Err(error) => tracing::error!(error = %error, "Leases could not be expired; trying again soon."),
        }
        tokio::time::sleep(EVERY).await;
    }
}
