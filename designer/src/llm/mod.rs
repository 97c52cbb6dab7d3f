//! The designer that asks a language model: an OpenAI-compatible endpoint gets the brief as a prompt and a JSON schema to
//! answer by; what it answers passes the gate, and what the gate refuses goes back with the gate's sentences.
//!
//! [`Llm`] is one endpoint with what all runs of a server share: connections, what the endpoint supports, retries, the
//! circuit breaker, the budget; whoever wants a model's word asks it ([`Llm::ask`]). [`LlmDesigner`] is one run's designer on it. Another API is another [`Chat`]. A model that
//! is slow, down, rate-limited, over budget or talking nonsense costs a run nothing but its ideas: every trouble is a typed
//! [`LlmError`] within a bounded time, and the caller goes on with another designer.

mod breaker;
mod budget;
pub mod chat;
mod client;
mod config;
mod designer;
mod error;
mod extract;
mod health;
mod openai;
mod ordered;
pub mod prompt;
mod retry;
#[cfg(test)]
mod tests;
mod tls;
mod tokens;
mod values;

pub use self::budget::Spent;
pub use self::chat::{Ask, Chat, Message, Reply, Role, Tokens};
pub use self::client::{Bill, Call, Llm};
pub use self::config::{LlmConfig, WallClock};
pub use self::designer::LlmDesigner;
pub use self::error::{LlmError, one_line};
pub use self::health::{Health, Latency};
pub use self::openai::OpenAi;
pub use self::tls::{http_client, tls_config};
pub use self::values::{MAX_TEXT, meant, values};
