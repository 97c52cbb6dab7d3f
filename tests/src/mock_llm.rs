//! Chat completion endpoints for tests: with scripted responses, with responses that the test releases, and a closed port.

use std::collections::VecDeque;
use std::future::IntoFuture;
use std::sync::{Arc, Mutex};

use axum::routing::post;
use axum::{Json, Router};
use serde_json::{Value, json};
use tokio::net::{TcpListener, TcpSocket};
use tokio::sync::{Semaphore, watch};
use wiremock::matchers::{header, method, path};
use wiremock::{Mock, MockServer, Request, Respond, ResponseTemplate};

/// API key that must be sent to the endpoint only, and appear nowhere else.
pub const API_KEY: &str = "sk-f00dfacecafe1234567890";
/// Action of the kessler worlds that does nothing.
pub const HOLD_ACTION: &str = r#"{"burns": []}"#;

/// Local port that refuses every connection. No other process can listen at the port while this value exists.
#[derive(Debug)]
pub struct ClosedPort(TcpSocket);

impl ClosedPort {
    /// Reserves a free port without listening at it.
    ///
    /// # Panics
    /// Panics if no port is free.
    #[must_use]
    pub fn reserve() -> Self {
        let socket = TcpSocket::new_v4().expect("a socket");
        socket.bind(([127, 0, 0, 1], 0).into()).expect("a port is free");
        Self(socket)
    }

    /// URL of the port.
    ///
    /// # Panics
    /// Panics if the operating system does not return the port of the socket.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}", self.0.local_addr().expect("the socket is bound"))
    }
}

/// Endpoint that holds its responses back until the test releases them, so that tests do not depend on delays.
#[derive(Debug)]
pub struct GatedEndpoint {
    url: String,
    received: watch::Receiver<usize>,
    released: Arc<Semaphore>,
}

impl GatedEndpoint {
    /// Starts an endpoint whose responses all have the message `content`.
    ///
    /// # Panics
    /// Panics if no port is free.
    pub async fn start(content: &'static str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port is free");
        let url = format!("http://{}", listener.local_addr().expect("the socket is bound"));
        let (received_sender, received) = watch::channel(0);
        let released = Arc::new(Semaphore::new(0));
        let gate = Arc::clone(&released);
        let respond = async move || {
            received_sender.send_modify(|requests| *requests += 1);
            gate.acquire().await.expect("the gate is never closed").forget();
            Json(chat_completion(content))
        };
        let router = Router::new().route("/v1/chat/completions", post(respond));
        tokio::spawn(axum::serve(listener, router).into_future());
        Self { url, received, released }
    }

    /// URL of the endpoint, without the path `/v1`.
    #[must_use]
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Waits until the endpoint has received `requests` requests since its start.
    ///
    /// # Panics
    /// Panics if the endpoint has stopped.
    pub async fn wait_for_requests(&self, requests: usize) {
        let mut received = self.received.clone();
        received.wait_for(|count| *count >= requests).await.expect("the endpoint runs");
    }

    /// Releases that many responses: those that are held back, then later ones.
    pub fn release(&self, responses: usize) {
        self.released.add_permits(responses);
    }
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
