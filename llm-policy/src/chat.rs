//! [`ChatPolicy`]: chooses the action of each step by a call of a language model.

use std::time::Duration;

use llm::{
    ChatCall, ChatRequest, ChatResponse, LlmClient, LlmError, Message, Role, TokenDetails, TokenUsage,
};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use tokio::time::Instant;

use super::history::ChatHistory;
use super::prompt::TaskPrompt;
use super::reply::parse_action;
use super::time_step::TimeStep;

/// Maximum length of an invalid reply that the repair conversation repeats, in characters.
const MAX_REPEATED_CHARS: usize = 400;
/// Calls of one step: the first one, and one repair.
const MAX_CALLS: usize = 2;

/// Settings of a chat policy.
#[derive(Debug, Clone)]
pub struct ChatSettings {
    /// Id of the run whose token budget pays for the calls.
    pub run: String,
    /// Maximum number of previous exchanges in the conversation.
    pub history: usize,
    /// Sampling temperature; `None` uses the endpoint's default.
    pub temperature: Option<f64>,
    /// Maximum number of tokens of one reply.
    pub max_tokens: u32,
}

/// One call of the model, with its reply.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Completion {
    /// Messages that were sent.
    pub messages: Vec<Message>,
    /// Text of the reply, unchanged; `None` if the call failed.
    pub text: Option<String>,
    /// True if the reply was cut off at the maximum number of tokens.
    pub truncated: bool,
    /// Error of the call, or the reason why the reply is not an action.
    pub error: Option<String>,
    /// Number of prompt tokens.
    pub tokens_in: u64,
    /// Number of completion tokens.
    pub tokens_out: u64,
    /// Duration of the call with its retries, in milliseconds.
    pub latency_ms: u64,
    /// Token ids and log-probabilities, if they were requested and the endpoint returns them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tokens: Option<TokenDetails>,
}

/// Reason why the model chose no action.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActionFailure {
    /// The reply is not an action, even after the repair.
    Invalid,
    /// The reply is not an action and was cut off at the maximum number of tokens.
    CutOff,
    /// The reply did not arrive in time.
    Timeout,
    /// The endpoint's response was not a chat completion.
    MalformedResponse,
}

/// One step of a chat policy: the action, and the calls that led to it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChatTurn {
    /// Number of the step, counted from 1.
    pub step: u32,
    /// Chosen action; *hold* if the model chose none.
    pub action: Value,
    /// Error message if the model chose no action.
    pub error: Option<String>,
    /// Category of `error`; `None` if the model chose an action.
    #[serde(skip)]
    pub failure: Option<ActionFailure>,
    /// Number of replies that were not an action.
    pub invalid: u32,
    /// Calls of the step: one, or two if the first reply was repaired.
    pub completions: Vec<Completion>,
}

/// Sums over the calls of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TurnUsage {
    /// Number of prompt tokens.
    pub tokens_in: u64,
    /// Number of completion tokens.
    pub tokens_out: u64,
    /// Time that the calls took.
    pub latency: Duration,
}

impl ChatTurn {
    /// Returns an empty turn of a step.
    const fn new(step: u32) -> Self {
        Self { step, action: Value::Null, error: None, failure: None, invalid: 0, completions: Vec::new() }
    }

    /// Sums the tokens and the latency of all calls.
    #[must_use]
    pub fn usage(&self) -> TurnUsage {
        let sum = |of: fn(&Completion) -> u64| self.completions.iter().map(of).fold(0, u64::saturating_add);
        TurnUsage {
            tokens_in: sum(|call| call.tokens_in),
            tokens_out: sum(|call| call.tokens_out),
            latency: Duration::from_millis(sum(|call| call.latency_ms)),
        }
    }
}

/// Policy of one episode that asks a language model for every action.
#[derive(Debug)]
pub struct ChatPolicy {
    llm: LlmClient,
    settings: ChatSettings,
    prompt: TaskPrompt,
    history: ChatHistory,
    /// Number of steps that were decided.
    steps: u32,
}

/// Reply of the model: its text, and the action in it or the reason why there is none.
struct ModelReply {
    text: String,
    action: Result<Value, String>,
}

impl ChatPolicy {
    /// Creates the policy at the start of an episode.
    #[must_use]
    pub fn new(llm: LlmClient, prompt: TaskPrompt, settings: ChatSettings) -> Self {
        let history = ChatHistory::new(settings.history);
        Self { llm, settings, prompt, history, steps: 0 }
    }

    /// Returns the prompt of the task.
    #[must_use]
    pub const fn prompt(&self) -> &TaskPrompt {
        &self.prompt
    }

    /// Returns the name of the model.
    #[must_use]
    pub fn model(&self) -> &str {
        &self.llm.config().model
    }

    /// Adds instructions of a user to the system message of the following steps.
    pub fn instruct(&mut self, instructions: &str) {
        self.prompt.add_instructions(instructions);
    }

    /// Chooses the action of the next step. A reply that is not an action is repaired once.
    ///
    /// If the repair fails too, the model times out, or the endpoint's response is malformed, then the action is *hold* and
    /// the turn has the error: such a failure counts as the agent's.
    ///
    /// # Errors
    /// Returns every other [`LlmError`]: the endpoint cannot be used, and the episode cannot go on.
    pub async fn act(&mut self, time_step: &TimeStep) -> Result<ChatTurn, LlmError> {
        let mut turn = ChatTurn::new(self.steps + 1);
        let request = self.prompt.user(turn.step, time_step);
        let mut messages = vec![Message::new(Role::System, self.prompt.system())];
        messages.extend(self.history.messages());
        messages.push(Message::new(Role::User, &request));
        let action = match self.decide(messages, &mut turn).await {
            Ok(action) => action,
            Err(error @ (LlmError::Timeout { .. } | LlmError::InvalidResponse { .. })) => {
                turn.error = Some(error.to_string());
                let is_timeout = matches!(error, LlmError::Timeout { .. });
                let failure =
                    if is_timeout { ActionFailure::Timeout } else { ActionFailure::MalformedResponse };
                turn.failure = Some(failure);
                None
            }
            Err(error) => return Err(error),
        };
        self.steps = turn.step;
        turn.action = action.unwrap_or_else(|| self.prompt.codec().hold());
        self.history.push(request, self.prompt.codec().to_text(&turn.action));
        Ok(turn)
    }

    /// Asks for an action, and asks once more with the reason if the reply is not one.
    async fn decide(
        &self,
        mut messages: Vec<Message>,
        turn: &mut ChatTurn,
    ) -> Result<Option<Value>, LlmError> {
        for _ in 0..MAX_CALLS {
            let ModelReply { text, action } = self.call(messages.clone(), turn).await?;
            let reason = match action {
                Ok(action) => {
                    (turn.error, turn.failure) = (None, None);
                    return Ok(Some(action));
                }
                Err(reason) => reason,
            };
            turn.invalid += 1;
            turn.error = Some(format!("the reply is not an action: {reason}"));
            let is_cut = turn.completions.last().is_some_and(|completion| completion.truncated);
            turn.failure = Some(if is_cut { ActionFailure::CutOff } else { ActionFailure::Invalid });
            let repeated: String = text.chars().take(MAX_REPEATED_CHARS).collect();
            // Some endpoints reject an empty message.
            let repeated = if repeated.trim().is_empty() { "(nothing)".to_owned() } else { repeated };
            messages.push(Message::new(Role::Assistant, repeated));
            messages.push(Message::new(Role::User, self.prompt.repair(&reason)));
        }
        Ok(None)
    }

    /// Sends one call and records it in `turn`.
    async fn call(&self, messages: Vec<Message>, turn: &mut ChatTurn) -> Result<ModelReply, LlmError> {
        let codec = self.prompt.codec();
        let request = ChatRequest {
            messages,
            schema: codec.schema().clone(),
            schema_name: "action",
            max_tokens: self.settings.max_tokens,
            temperature: self.settings.temperature,
        };
        let (started, mut usage) = (Instant::now(), TokenUsage::default());
        let call = ChatCall { run: &self.settings.run, request: &request, deadline: None };
        let result = self.llm.complete(&call, &mut usage).await;
        let mut completion = Completion {
            messages: request.messages,
            text: None,
            truncated: false,
            error: None,
            tokens_in: usage.tokens_in,
            tokens_out: usage.tokens_out,
            latency_ms: u64::try_from(started.elapsed().as_millis()).unwrap_or(u64::MAX),
            tokens: None,
        };
        let reply = match result {
            Ok(response) => Ok(self.record_response(response, &mut completion)),
            Err(error) => {
                completion.error = Some(error.to_string());
                Err(error)
            }
        };
        turn.completions.push(completion);
        reply
    }

    /// Records a response in its completion and parses the action in it.
    fn record_response(&self, response: ChatResponse, completion: &mut Completion) -> ModelReply {
        let is_cut = response.is_truncated;
        let action = parse_action(&response.text, self.prompt.codec(), self.llm.config()).map_err(|reason| {
            if is_cut { format!("{reason}; it was cut off at the maximum number of tokens") } else { reason }
        });
        completion.truncated = is_cut;
        completion.tokens = response.token_details;
        if let (Some(last), Some(schema)) = (completion.messages.last_mut(), response.appended_schema) {
            last.content.push_str(&schema);
        }
        completion.error = action.as_ref().err().cloned();
        completion.text = Some(response.text.clone());
        ModelReply { text: response.text, action }
    }
}
