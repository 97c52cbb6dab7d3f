//! Requests, responses, and the trait that an API implements: [`ChatBackend`].

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::LlmError;

/// Author of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Instructions that apply to the whole conversation.
    System,
    /// Requests of the caller.
    User,
    /// Answers of the model.
    Assistant,
}

/// One message of a conversation.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Message {
    /// Author of the message.
    pub role: Role,
    /// Text of the message.
    pub content: String,
}

impl Message {
    /// Creates a message of an author.
    pub fn new(role: Role, content: impl Into<String>) -> Self {
        Self { role, content: content.into() }
    }
}

/// One request to a model.
#[derive(Debug, Clone, PartialEq)]
pub struct ChatRequest {
    /// Conversation so far, oldest message first.
    pub messages: Vec<Message>,
    /// JSON schema of the answer. Endpoints that can do so enforce it; the answer may still be any text.
    pub schema: Arc<Value>,
    /// Name of the schema as the endpoint receives it: letters and underscores.
    pub schema_name: &'static str,
    /// Token limit of the answer.
    pub max_tokens: u32,
    /// Sampling temperature; the endpoint's default if `None`.
    pub temperature: Option<f64>,
}

impl ChatRequest {
    /// Estimates the prompt tokens. English and JSON have three to four bytes a token; the estimate is slightly high, so that
    /// budgets are not exceeded.
    #[must_use]
    pub fn estimate_tokens(&self) -> u64 {
        let of = |message: &Message| estimate_tokens(&message.content).saturating_add(8);
        self.messages.iter().map(of).fold(0, u64::saturating_add)
    }
}

/// Estimates the tokens of a text from its length.
pub(crate) const fn estimate_tokens(text: &str) -> u64 {
    (text.len() as u64).div_ceil(3)
}

/// Token ids and log-probabilities of a call, as far as the endpoint returns them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TokenDetails {
    /// Token ids of the conversation as the model read it.
    pub prompt: Option<Vec<u32>>,
    /// Token ids of the answer.
    pub completion: Option<Vec<u32>>,
    /// Natural logarithm of the probability of each token of the answer.
    pub logprobs: Option<Vec<f64>>,
}

/// Answer of a model.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ChatResponse {
    /// Text that the model wrote.
    pub text: String,
    /// Prompt tokens, if the endpoint reports them.
    pub tokens_in: Option<u64>,
    /// Completion tokens, if the endpoint reports them.
    pub tokens_out: Option<u64>,
    /// True if the answer was cut off at the token limit.
    pub is_truncated: bool,
    /// Text that was appended to the last message to state the schema, if the endpoint does not enforce it.
    pub appended_schema: Option<String>,
    /// Token ids and log-probabilities, if [`crate::LlmConfig::token_details`] requests them and the endpoint returns them.
    pub token_details: Option<TokenDetails>,
}

/// Tokens and cost of one or more calls.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TokenUsage {
    /// Number of prompt tokens.
    pub tokens_in: u64,
    /// Number of completion tokens.
    pub tokens_out: u64,
    /// Cost, in the currency of the configured prices.
    pub cost: f64,
}

impl TokenUsage {
    /// Adds the usage of another call.
    pub fn add(&mut self, other: Self) {
        self.tokens_in = self.tokens_in.saturating_add(other.tokens_in);
        self.tokens_out = self.tokens_out.saturating_add(other.tokens_out);
        self.cost += other.cost;
    }
}

/// Way in which an answer is constrained to the schema of its request, from strong to weak.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ResponseFormat {
    /// The endpoint enforces the schema.
    JsonSchema,
    /// The endpoint enforces a JSON object; the prompt states the schema.
    JsonObject,
    /// Plain text; the prompt states the schema.
    Text,
}

impl ResponseFormat {
    /// Returns the next weaker format; `None` for [`ResponseFormat::Text`].
    pub(crate) const fn weaker(self) -> Option<Self> {
        match self {
            Self::JsonSchema => Some(Self::JsonObject),
            Self::JsonObject => Some(Self::Text),
            Self::Text => None,
        }
    }

    /// Returns the name of the format in OpenAI's API.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::JsonSchema => "json_schema",
            Self::JsonObject => "json_object",
            Self::Text => "text",
        }
    }
}

/// Future that [`ChatBackend::send`] returns.
pub type ChatFuture<'a> = Pin<Box<dyn Future<Output = Result<ChatResponse, LlmError>> + Send + 'a>>;

/// API of a language model. An implementation knows how to constrain answers to a schema; retries, budgets and the circuit
/// breaker belong to [`crate::LlmClient`].
pub trait ChatBackend: Send + Sync + 'static {
    /// Sends a request once. Makes at most `requests_left` (>= 1) HTTP requests and subtracts those it made.
    fn send<'a>(&'a self, request: &'a ChatRequest, requests_left: &'a mut u32) -> ChatFuture<'a>;

    /// Returns the response format that the endpoint is known to accept.
    fn response_format(&self) -> ResponseFormat;
}
