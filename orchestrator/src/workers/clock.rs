//! Watches the clock of the day: where it jumps nobody's lease ends by that.

use std::time::Duration;

use crate::clock::Clock;
use crate::engine::shift_deadlines::ShiftDeadlines;
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;

/// How often it looks.
const EVERY: Duration = Duration::from_millis(500);

/// Works until the writer is gone.
pub async fn run(clock: Clock, writer: Writer) {
    loop {
        if clock.jumped().is_some() {
            match writer.change(ShiftDeadlines(clock.clone())).await {
                Ok(None) => {}
                Ok(Some(by_ms)) => {
                    tracing::warn!(by_ms, "The clock jumped; leases hold as long as they would have.");
                }
                Err(ServiceError::Stopping) => return,
                Err(error) => {
                    tracing::error!(error = %error, "The clock jumped, and leases could not be moved; trying again.");
                }
            }
        }
        tokio::time::sleep(EVERY).await;
    }
}
