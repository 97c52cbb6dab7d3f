//! Fake models for tests: HTTP endpoints with scripted responses, and a backend without a network.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use serde_json::{Value, json};
use wiremock::matchers::{method, path};
use wiremock::{Mock, MockServer, Request, Respond, ResponseTemplate};

use crate::{
    ChatBackend, ChatFuture, ChatRequest, ChatResponse, LlmClient, LlmConfig, LlmError, ResponseFormat,
    WallClock,
};

/// 2026-01-01 00:00 UTC, the time of [`test_config`]'s clock, in milliseconds since 1970.
pub const NEW_YEAR_MS: i64 = 1_767_225_600_000;

/// Returns a configuration with a short backoff, a timeout that no response on a busy machine exceeds, and a fixed clock.
#[must_use]
pub fn test_config(url: &str) -> LlmConfig {
    let mut config = LlmConfig::new(format!("{url}/v1"), "small", WallClock::new(|| NEW_YEAR_MS));
    config.timeout = Duration::from_secs(60);
    config.backoff = Duration::from_millis(5);
    config
}

/// Returns the body of a chat completion with this text: 100 prompt and 50 completion tokens.
#[must_use]
pub fn completion(text: &str) -> Value {
    json!({
        "id": "1", "object": "chat.completion",
        "choices": [{"index": 0, "message": {"role": "assistant", "content": text}, "finish_reason": "stop"}],
        "usage": {"prompt_tokens": 100, "completion_tokens": 50, "total_tokens": 150},
    })
}

/// Returns an HTTP response with [`completion`] as its body.
#[must_use]
pub fn answer(text: &str) -> ResponseTemplate {
    ResponseTemplate::new(200).set_body_json(completion(text))
}

/// Starts an endpoint that returns these responses in turn, and the last one from then on.
pub async fn start_endpoint(responses: impl IntoIterator<Item = ResponseTemplate>) -> MockServer {
    let server = MockServer::start().await;
    let script = ScriptedResponses(Script::new(responses));
    Mock::given(method("POST")).and(path("/v1/chat/completions")).respond_with(script).mount(&server).await;
    server
}

/// Returns the JSON bodies that an endpoint has received.
///
/// # Panics
/// Panics if a body is not JSON.
pub async fn received_bodies(server: &MockServer) -> Vec<Value> {
    let requests = server.received_requests().await.unwrap_or_default();
    let parse = |request: &Request| serde_json::from_slice(&request.body).expect("a JSON body");
    requests.iter().map(parse).collect()
}

/// Returns the response of a model with this text, 100 prompt tokens and 50 completion tokens.
#[must_use]
pub fn chat_response(text: &str) -> ChatResponse {
    ChatResponse {
        text: text.to_owned(),
        tokens_in: Some(100),
        tokens_out: Some(50),
        ..ChatResponse::default()
    }
}

/// Number of requests that a [`ScriptedModel`] has received. Clones share it.
#[derive(Debug, Clone, Default)]
pub struct CallCount(Arc<Mutex<u32>>);

impl CallCount {
    /// Returns the number of requests so far.
    #[must_use]
    pub fn get(&self) -> u32 {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn increment(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) += 1;
    }
}

/// Model without a network, for tests under a paused clock.
pub struct ScriptedModel {
    /// Client whose backend is scripted.
    pub client: LlmClient,
    /// Number of requests that the backend has received.
    pub calls: CallCount,
}

impl ScriptedModel {
    /// Creates a client whose backend returns these results in turn, each after `delay`, and the last one from then on.
    ///
    /// # Panics
    /// Panics if the configuration is invalid.
    pub fn new(
        config: LlmConfig,
        delay: Duration,
        results: impl IntoIterator<Item = Result<ChatResponse, LlmError>>,
    ) -> Self {
        let calls = CallCount::default();
        let backend = ScriptedBackend { delay, results: Script::new(results), calls: calls.clone() };
        let client = LlmClient::with_backend(config, Box::new(backend)).expect("a valid configuration");
        Self { client, calls }
    }
}

/// Backend that returns scripted results, each after a delay.
struct ScriptedBackend {
    delay: Duration,
    results: Script<Result<ChatResponse, LlmError>>,
    calls: CallCount,
}

impl ChatBackend for ScriptedBackend {
    fn send<'a>(&'a self, _: &'a ChatRequest, requests_left: &'a mut u32) -> ChatFuture<'a> {
        Box::pin(async move {
            *requests_left = requests_left.saturating_sub(1);
            self.calls.increment();
            tokio::time::sleep(self.delay).await;
            self.results.next()
        })
    }

    fn response_format(&self) -> ResponseFormat {
        ResponseFormat::Text
    }
}

/// Entries that are taken in turn; the last one is repeated.
struct Script<T>(Mutex<VecDeque<T>>);

impl<T: Clone> Script<T> {
    fn new(entries: impl IntoIterator<Item = T>) -> Self {
        Self(Mutex::new(entries.into_iter().collect()))
    }

    fn next(&self) -> T {
        let mut left = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if left.len() > 1 { left.pop_front().expect("more than one entry") } else { left[0].clone() }
    }
}

struct ScriptedResponses(Script<ResponseTemplate>);

impl Respond for ScriptedResponses {
    fn respond(&self, _: &Request) -> ResponseTemplate {
        self.0.next()
    }
}
