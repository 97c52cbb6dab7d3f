//! Tests of the client against scripted backends and misbehaving endpoints.

mod breaker;
mod faults;
mod formats;
mod usage;

use std::sync::Arc;
use std::time::Duration;

use serde_json::{Value, json};
use wiremock::ResponseTemplate;

use crate::testing::{
    NEW_YEAR_MS, ScriptedModel, answer, chat_response, completion, received_bodies, start_endpoint,
    test_config,
};
use crate::{
    BreakerState, ChatCall, ChatRequest, ChatResponse, LlmClient, LlmConfig, LlmError, Message,
    ResponseFormat, Role, Spending, TokenUsage, WallClock,
};

/// URL at which nothing listens, for clients with a scripted backend.
const NO_ENDPOINT: &str = "http://127.0.0.1:1";

/// Request with an estimate of 12 prompt tokens and at most 100 completion tokens.
fn request() -> ChatRequest {
    ChatRequest {
        messages: vec![Message::new(Role::User, "a question")],
        schema: Arc::new(json!({"type": "object"})),
        schema_name: "answer",
        max_tokens: 100,
        temperature: None,
    }
}

/// Sends [`request`] for a run.
async fn complete(client: &LlmClient, run: &str) -> Result<ChatResponse, LlmError> {
    complete_with_usage(client, run).await.0
}

/// Sends [`request`] for a run, and returns the usage of all attempts too.
async fn complete_with_usage(client: &LlmClient, run: &str) -> (Result<ChatResponse, LlmError>, TokenUsage) {
    let (request, mut usage) = (request(), TokenUsage::default());
    let call = ChatCall { run, request: &request, deadline: None };
    (client.complete(&call, &mut usage).await, usage)
}
