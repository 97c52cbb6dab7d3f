//! Chat client of language models behind OpenAI-compatible endpoints.
//!
//! [`LlmClient`] is one endpoint with everything that all its users share: connections, the learned way to constrain
//! answers to a schema, retries, the circuit breaker, the budget and health figures. A caller sends a [`ChatRequest`] with
//! [`LlmClient::complete`] and gets a [`ChatResponse`] or a typed [`LlmError`] within a bounded time.
//!
//! - `client` runs one call: concurrency limit, budget reservation, circuit breaker.
//! - `endpoint` sends it in attempts; `retry` has the pauses between them.
//! - `openai` implements [`ChatBackend`] for `chat/completions`; another API is another implementation.
//! - `extract` finds JSON values in the text of an answer.
//!
//! Prompts and the meaning of answers belong to the callers (designer, chat policy, judge). Start reading at `client`.

mod breaker;
mod budget;
mod call;
mod chat;
mod client;
mod config;
mod endpoint;
mod error;
mod extract;
#[doc(hidden)]
pub mod fuzzing;
mod health;
mod openai;
mod ordered_schema;
mod retry;
mod sanitize;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
#[cfg(test)]
mod tests;
mod tls;
mod token_details;

pub use self::breaker::BreakerState;
pub use self::budget::Spending;
pub use self::call::ChatCall;
pub use self::chat::{
    ChatBackend, ChatFuture, ChatRequest, ChatResponse, Message, ResponseFormat, Role, TokenDetails,
    TokenUsage,
};
pub use self::client::LlmClient;
pub use self::config::{LlmConfig, WallClock};
pub use self::error::LlmError;
pub use self::extract::{MAX_ANSWER_BYTES, json_values, strip_reasoning};
pub use self::health::{Health, LastError, LatencySummary};
pub use self::openai::OpenAi;
pub use self::ordered_schema::OrderedSchema;
pub use self::sanitize::{sanitize_line, sanitize_line_to};
pub use self::tls::{TrustedRoots, http_client_builder, tls_config};
