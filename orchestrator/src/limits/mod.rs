//! Limits on what clients may use: connections, sessions, requests, bodies, long polls and expensive work.
//!
//! - [`Quota`] limits permits in total and for each key (a client, an IP address).
//! - [`ConcurrencyLimit`] limits how many expensive requests run at the same time.
//! - [`BodyLimit`] limits how many large request bodies are in memory.
//! - [`LongPollLimit`] limits how many requests wait for finished groups.
//! - [`RateLimit`] limits requests per second of each key.
//!
//! This module knows nothing of HTTP. It returns its own errors, and `http` maps them to responses. The values of the
//! limits are in [`constants`], except those that the operator sets: [`ClientLimits`] and
//! [`SessionLimits`](crate::sessions::SessionLimits). Start reading at [`Quota`].

mod body_limit;
mod client_limits;
mod concurrency;
pub mod constants;
mod long_poll;
mod quota;
mod rate_limit;

pub use self::body_limit::{BodyLimit, LimitClosed};
pub use self::client_limits::ClientLimits;
pub use self::concurrency::{ConcurrencyError, ConcurrencyLimit, ConcurrencyLimits};
pub use self::long_poll::{LongPollLimit, PushWatch, TooManyLongPolls};
pub use self::quota::{Quota, QuotaExceeded, QuotaPermit, TotalPermit};
pub use self::rate_limit::{RateLimit, RateLimited};
