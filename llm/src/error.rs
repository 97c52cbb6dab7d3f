//! Errors of calls to a language model.

use std::time::Duration;

/// Reason why a call to a language model failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LlmError {
    /// A setting of [`crate::LlmConfig`] or a request is invalid.
    #[error("{field}: {reason}")]
    Config {
        /// Name of the setting.
        field: &'static str,
        /// Problem, and the values that are allowed.
        reason: String,
    },
    /// The response did not arrive in time.
    #[error("the model did not answer within {:.0} s", .after.as_secs_f64())]
    Timeout {
        /// Time limit that was exceeded.
        after: Duration,
    },
    /// The connection failed before a response began.
    #[error("the model's endpoint cannot be reached: {reason}")]
    Connection {
        /// Cause, as one line.
        reason: String,
    },
    /// The connection broke while the response was read.
    #[error("the connection to the model's endpoint broke during the response: {reason}")]
    ConnectionLost {
        /// Cause, as one line.
        reason: String,
    },
    /// The endpoint returned an error status other than 429.
    #[error("the model's endpoint returned status {status}: {body}")]
    Refused {
        /// HTTP status, or the code in the body of a gateway that answers 200.
        status: u16,
        /// Beginning of the response body, as one line.
        body: String,
    },
    /// The endpoint returned status 429.
    #[error("the model's endpoint limits the rate of requests{}", display_retry_after(*.retry_after))]
    RateLimited {
        /// Value of the `Retry-After` header, if present and valid.
        retry_after: Option<Duration>,
    },
    /// The rest of a budget does not cover the cost of the call.
    #[error("the budget of {budget} does not cover another call: {used} of {limit} is spent or reserved")]
    Budget {
        /// Name of the exhausted budget.
        budget: &'static str,
        /// Spent and reserved amount.
        used: f64,
        /// Limit of the budget, in the unit of `used`.
        limit: f64,
    },
    /// The circuit breaker is open after repeated failures, so that no request was sent.
    #[error("calls of the model are paused for {:.0} s after repeated failures; last failure: {last_error}", .retry_in.as_secs_f64())]
    CircuitOpen {
        /// Time until the next trial call.
        retry_in: Duration,
        /// Message of the failure that opened the breaker.
        last_error: String,
    },
    /// The response is no valid chat completion, or the model declined to answer.
    #[error("the model's response is invalid: {reason}")]
    InvalidResponse {
        /// Problem of the response.
        reason: String,
        /// Prompt tokens that the endpoint reports, and bills, for it.
        tokens_in: Option<u64>,
        /// Completion tokens that the endpoint reports, and bills, for it.
        tokens_out: Option<u64>,
    },
}

impl LlmError {
    /// Returns the kind of the error as a metric label.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Config { .. } => "config",
            Self::Timeout { .. } => "timeout",
            Self::Connection { .. } | Self::ConnectionLost { .. } => "connection",
            Self::Refused { .. } => "refused",
            Self::RateLimited { .. } => "rate_limited",
            Self::Budget { .. } => "budget",
            Self::CircuitOpen { .. } => "open",
            Self::InvalidResponse { .. } => "nonsense",
        }
    }

    /// Returns true if the same call may succeed a little later.
    pub(crate) const fn is_transient(&self) -> bool {
        match self {
            Self::Connection { .. } | Self::ConnectionLost { .. } | Self::RateLimited { .. } => true,
            Self::Refused { status, .. } => matches!(status, 408 | 409 | 500 | 502..=599),
            _ => false,
        }
    }

    /// Returns true if the endpoint may bill a call that failed with this error.
    pub(crate) const fn may_be_billed(&self) -> bool {
        matches!(self, Self::Timeout { .. } | Self::ConnectionLost { .. } | Self::InvalidResponse { .. })
    }
}

fn display_retry_after(retry_after: Option<Duration>) -> String {
    retry_after.map_or_else(String::new, |after| format!("; retry after {:.0} s", after.as_secs_f64()))
}
