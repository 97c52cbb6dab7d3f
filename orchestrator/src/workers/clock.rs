//! Watches the wall clock: when it jumps, deadlines are shifted, so that no lease ends by the jump.

use std::time::Duration;

use crate::engine::shift_deadlines::ShiftDeadlines;
use crate::engine::writer::Writer;
use crate::workers::round_error::ends_worker;
use clock::Clock;

/// Interval between two checks.
const POLL_INTERVAL: Duration = Duration::from_millis(500);

/// Runs until the writer stops.
pub(super) async fn run(clock: Clock, writer: Writer) {
    loop {
        if clock.jumped().is_some() {
            match writer.change(ShiftDeadlines(clock.clone())).await {
                Ok(None) => {}
                Ok(Some(by_ms)) => {
                    tracing::warn!(by_ms, "The clock jumped; the deadlines of leases were shifted.");
                }
                Err(error) if ends_worker(&error, "the clock jumped, and deadlines could not be shifted") => {
                    return;
                }
                Err(_) => {}
            }
        }
        tokio::time::sleep(POLL_INTERVAL).await;
    }
}
