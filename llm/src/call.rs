//! [`ChatCall`]: a request with its payer and its deadline.

use std::time::Duration;

use tokio::time::Instant;

use crate::{ChatRequest, LlmError};

/// One call: a request with the run that pays for it.
#[derive(Debug, Clone, Copy)]
pub struct ChatCall<'a> {
    /// Id of the run whose budget the call uses.
    pub run: &'a str,
    /// Request that is sent.
    pub request: &'a ChatRequest,
    /// Time at which the caller gives up; `None` waits as long as [`crate::LlmConfig::timeout`] and retries allow.
    pub deadline: Option<Instant>,
}

impl ChatCall<'_> {
    /// Returns true if the deadline is no more than `time` away.
    pub(crate) fn is_due_within(&self, time: Duration) -> bool {
        self.deadline.is_some_and(|deadline| deadline.saturating_duration_since(Instant::now()) <= time)
    }

    /// Waits for `work` until the deadline of the call.
    ///
    /// # Errors
    /// Returns the error of `work`, or [`LlmError::Timeout`] with the time since `started` at the deadline.
    pub(crate) async fn before_deadline<T>(
        &self,
        started: Instant,
        work: impl Future<Output = Result<T, LlmError>>,
    ) -> Result<T, LlmError> {
        match self.deadline {
            None => work.await,
            Some(deadline) => tokio::time::timeout_at(deadline, work)
                .await
                .unwrap_or_else(|_| Err(LlmError::Timeout { after: started.elapsed() })),
        }
    }
}
