//! A language model's endpoint, as a test wants it to answer.

use std::collections::VecDeque;
use std::sync::Mutex;

use serde_json::{Value, json};
use wiremock::matchers::{header, method, path};
use wiremock::{Mock, MockServer, Request, Respond, ResponseTemplate};

/// The key that must be told to nobody but the endpoint.
pub const KEY: &str = "sk-f00dfacecafe1234567890";
/// Doing nothing, in kessler.
pub const HOLD: &str = r#"{"burns": []}"#;

/// A chat completion.
#[must_use]
pub fn completion(content: &str) -> Value {
    json!({
        "choices": [{"message": {"role": "assistant", "content": content}, "finish_reason": "stop"}],
        "usage": {"prompt_tokens": 900, "completion_tokens": 20},
    })
}

/// An answer that says this.
#[must_use]
pub fn says(content: &str) -> ResponseTemplate {
    ResponseTemplate::new(200).set_body_json(completion(content))
}

/// Answers in turn; the last for ever.
struct Script(Mutex<VecDeque<ResponseTemplate>>);

impl Respond for Script {
    fn respond(&self, _: &Request) -> ResponseTemplate {
        let mut left = self.0.lock().expect("nobody panicked");
        if left.len() > 1 { left.pop_front().expect("there are two") } else { left[0].clone() }
    }
}

/// An endpoint that answers so in turn, to who brings the key.
pub async fn endpoint(answers: impl IntoIterator<Item = ResponseTemplate>) -> MockServer {
    let server = MockServer::start().await;
    let script = Script(Mutex::new(answers.into_iter().collect()));
    Mock::given(method("POST"))
        .and(path("/v1/chat/completions"))
        .and(header("authorization", format!("Bearer {KEY}").as_str()))
        .respond_with(script)
        .mount(&server)
        .await;
    server
}

/// What it was sent.
///
/// # Panics
/// Where that was no JSON.
pub async fn sent(server: &MockServer) -> Vec<Value> {
    let requests = server.received_requests().await.expect("requests are recorded");
    requests.iter().map(|request| serde_json::from_slice(&request.body).expect("JSON")).collect()
}
