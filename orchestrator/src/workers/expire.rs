//! Ends leases whose time is over.

use std::time::Duration;

use crate::leases::end::ExpireLeases;
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;

/// How often it looks.
const EVERY: Duration = Duration::from_millis(500);

/// Works until the writer is gone.
pub async fn run(writer: Writer) {
    loop {
        match writer.change(ExpireLeases).await {
            Ok(0) => {}
            Ok(ended) => {
                tracing::info!(ended, "Leases expired; what was not reported is offered again.");
                continue; // there may be more
            }
            Err(ServiceError::Stopping) => return,
            Err(error) => tracing::error!(error = %error, "Leases could not be expired; trying again soon."),
        }
        tokio::time::sleep(EVERY).await;
    }
}
