//! What an API must be able to do: one call.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;

use serde::Serialize;
use serde_json::Value;

use super::LlmError;

/// Who speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Who sets the rules.
    System,
    /// Who asks.
    User,
    /// The model.
    Assistant,
}

/// One message of a conversation.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Message {
    /// Who speaks.
    pub role: Role,
    /// What.
    pub content: String,
}

impl Message {
    /// A message.
    pub fn new(role: Role, content: impl Into<String>) -> Self {
        Self { role, content: content.into() }
    }
}

/// One question.
#[derive(Debug, Clone, PartialEq)]
pub struct Ask {
    /// The conversation so far.
    pub messages: Vec<Message>,
    /// The JSON schema of the answer. A model is held to it where the endpoint can; the answer may be anything all the same.
    pub schema: Arc<Value>,
    /// What the schema is of, as an endpoint is told it: a word of letters and underscores.
    pub name: &'static str,
    /// Tokens of the answer, at most.
    pub max_tokens: u32,
    /// How freely the model chooses its words; where nothing is said, the endpoint decides.
    pub temperature: Option<f64>,
}

impl Ask {
    /// Tokens that it comes to, roughly: English and JSON have three to four bytes a token; here a little too many are
    /// guessed, for a budget's sake.
    #[must_use]
    pub fn guess_tokens(&self) -> u64 {
        let of = |message: &Message| guess_tokens(&message.content).saturating_add(8);
        self.messages.iter().map(of).fold(0, u64::saturating_add)
    }
}

/// Tokens of a text, guessed from its length.
pub(super) const fn guess_tokens(text: &str) -> u64 {
    (text.len() as u64).div_ceil(3)
}

/// Tokens as the endpoint's model has them, as far as the endpoint tells.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Tokens {
    /// Of the conversation, as the model read it.
    pub prompt: Option<Vec<u32>>,
    /// Of the answer.
    pub completion: Option<Vec<u32>>,
    /// The natural logarithm of the probability with which each token of the answer was chosen.
    pub logprobs: Option<Vec<f64>>,
}

/// One answer.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Reply {
    /// What the model said.
    pub text: String,
    /// Tokens in, where the endpoint says.
    pub tokens_in: Option<u64>,
    /// Tokens out, where the endpoint says.
    pub tokens_out: Option<u64>,
    /// The answer ended because it may not be longer.
    pub cut: bool,
    /// What was put to the end of the last message, where the endpoint is not held to a schema otherwise.
    pub appended: Option<String>,
    /// Its tokens, where they were asked for and are told.
    pub tokens: Option<Tokens>,
}

/// What a call comes to, in time.
pub type Calling<'a> = Pin<Box<dyn Future<Output = Result<Reply, LlmError>> + Send + 'a>>;

/// An API of a language model. Retries, budgets and breakers are not its business ([`super::Llm`]); how the endpoint is
/// best held to a schema is.
pub trait Chat: Send + Sync + 'static {
    /// Asks once. It makes no more than so many `requests` (at least one), and takes off those it made.
    fn ask<'a>(&'a self, ask: &'a Ask, requests: &'a mut u32) -> Calling<'a>;

    /// How the endpoint is held to a schema, as far as it is known.
    fn mode(&self) -> &'static str;
}
