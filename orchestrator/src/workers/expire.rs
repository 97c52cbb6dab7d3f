//! Expires leases whose deadline has passed.

use std::time::Duration;

use crate::engine::writer::Writer;
use crate::leases::end::ExpireLeases;
use crate::workers::round_error::ends_worker;

/// Interval between two checks.
const POLL_INTERVAL: Duration = Duration::from_millis(500);

/// Runs until the writer stops.
pub(super) async fn run(writer: Writer) {
    loop {
        match writer.change(ExpireLeases).await {
            Ok(0) => {}
            Ok(expired) => {
                tracing::info!(expired, "Leases expired; scenarios of lost groups return to the queue.");
                continue; // one change expires a limited number of leases
            }
            Err(error) if ends_worker(&error, "leases could not be expired") => return,
            Err(_) => {}
        }
        tokio::time::sleep(POLL_INTERVAL).await;
    }
}
