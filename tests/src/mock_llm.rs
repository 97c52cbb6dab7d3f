//! Chat completion endpoint that returns scripted responses.

use std::collections::VecDeque;
use std::sync::Mutex;

use serde_json::{Value, json};
use wiremock::matchers::{header, method, path};
use wiremock::{Mock, MockServer, Request, Respond, ResponseTemplate};

/// API key that must be sent to the endpoint only, and appear nowhere else.
pub const API_KEY: &str = "sk-f00dfacecafe1234567890";
/// Action of the kessler worlds that does nothing.
pub const HOLD_ACTION: &str = r#"{"burns": []}"#;

/// Returns the URL of a local port without a listener.
///
/// # Panics
/// Panics if no port is free.
pub async fn unused_url() -> String {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.expect("a port is free");
    format!("http://{}", listener.local_addr().expect("the socket is bound"))
}

/// Returns true if the bytes contain [`API_KEY`].
#[must_use]
pub fn contains_api_key(bytes: &[u8]) -> bool {
    bytes.windows(API_KEY.len()).any(|window| window == API_KEY.as_bytes())
}

/// Builds the body of a chat completion.
#[must_use]
pub fn chat_completion(content: &str) -> Value {
    json!({
        "choices": [{"message": {"role": "assistant", "content": content}, "finish_reason": "stop"}],
        "usage": {"prompt_tokens": 900, "completion_tokens": 20},
    })
}

/// Builds a response whose message is `content`.
#[must_use]
pub fn chat_response(content: &str) -> ResponseTemplate {
    ResponseTemplate::new(200).set_body_json(chat_completion(content))
}

/// Returns its responses one after another, and repeats the last one.
struct ResponseSequence(Mutex<VecDeque<ResponseTemplate>>);

impl Respond for ResponseSequence {
    fn respond(&self, _: &Request) -> ResponseTemplate {
        let mut remaining = self.0.lock().expect("the lock is not poisoned");
        if remaining.len() > 1 {
            remaining.pop_front().expect("at least two responses")
        } else {
            remaining[0].clone()
        }
    }
}

/// Starts an endpoint that returns `responses` in order to requests with [`API_KEY`].
pub async fn start_endpoint(responses: impl IntoIterator<Item = ResponseTemplate>) -> MockServer {
    let server = MockServer::start().await;
    let sequence = ResponseSequence(Mutex::new(responses.into_iter().collect()));
    Mock::given(method("POST"))
        .and(path("/v1/chat/completions"))
        .and(header("authorization", format!("Bearer {API_KEY}").as_str()))
        .respond_with(sequence)
        .mount(&server)
        .await;
    server
}

/// Returns the JSON bodies of all requests that the endpoint received.
///
/// # Panics
/// Panics if a body is not JSON.
pub async fn received_bodies(server: &MockServer) -> Vec<Value> {
    let requests = server.received_requests().await.expect("requests are recorded");
    requests.iter().map(|request| serde_json::from_slice(&request.body).expect("JSON")).collect()
}
