//! HTTP client of a server under test.

use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use tokio_tungstenite::Connector;

use crate::Lease;
use crate::polling::Polling;

/// Creates an HTTP client without TLS.
///
/// # Panics
/// Panics if the client cannot be built.
#[must_use]
pub fn http_client() -> reqwest::Client {
    llm::http_client_builder(llm::TrustedRoots::None)
        .expect("plain HTTP needs nothing")
        .build()
        .expect("a client")
}

/// HTTP client of the API, as a trainer uses it.
#[derive(Clone)]
pub struct ApiClient {
    client: reqwest::Client,
    /// How WebSockets connect to a server with TLS.
    connector: Option<Connector>,
    base: String,
    token: Option<String>,
    /// Name of the OpenEnv session of all requests.
    session: Option<String>,
}

impl std::fmt::Debug for ApiClient {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ApiClient").field("base", &self.base).finish_non_exhaustive()
    }
}

/// Response of the API: status, some headers and the JSON body.
#[derive(Debug, Clone)]
pub struct ApiResponse {
    /// HTTP status of the response.
    pub status: u16,
    /// Value of the `content-type` header; empty if absent.
    pub content_type: String,
    /// Value of the `retry-after` header, if present.
    pub retry_after: Option<String>,
    /// JSON body; a JSON string if the body is no JSON.
    pub body: Value,
}

impl ApiResponse {
    /// Returns the body after a check of the status.
    ///
    /// # Panics
    /// Panics if the status differs from `status`.
    #[must_use]
    #[track_caller]
    pub fn expect(self, status: u16) -> Value {
        assert_eq!(self.status, status, "{}", self.body);
        self.body
    }

    /// Parses the body as a type of the API after a check of the status.
    ///
    /// # Errors
    /// Returns an error with the body if the status is not a success or the body has another type.
    pub fn parse<T: DeserializeOwned>(self) -> anyhow::Result<T> {
        anyhow::ensure!((200..300).contains(&self.status), "status {}: {}", self.status, self.body);
        Ok(serde_json::from_value(self.body)?)
    }
}

impl ApiClient {
    /// Creates a client of the server at the URL `base`.
    #[must_use]
    pub fn new(base: &str) -> Self {
        Self { client: http_client(), connector: None, base: base.to_owned(), token: None, session: None }
    }

    /// Returns the same client with connections that use TLS.
    pub(crate) fn with_tls(self, client: reqwest::Client, connector: Connector) -> Self {
        Self { client, connector: Some(connector), ..self }
    }

    /// Returns the same client with a bearer token.
    #[must_use]
    pub fn with_token(self, token: &str) -> Self {
        Self { token: Some(token.to_owned()), ..self }
    }

    /// Returns the same client with a name of its OpenEnv session.
    #[must_use]
    pub fn with_session(self, name: &str) -> Self {
        Self { session: Some(name.to_owned()), ..self }
    }

    /// Token that the client sends, if any.
    #[must_use]
    pub fn token(&self) -> Option<&str> {
        self.token.as_deref()
    }

    /// URL of the server.
    #[must_use]
    pub fn base(&self) -> &str {
        &self.base
    }

    /// URL of a WebSocket of the server.
    #[must_use]
    pub fn websocket_url(&self, path: &str) -> String {
        format!("{}{path}", self.base.replacen("http", "ws", 1))
    }

    /// How WebSockets connect to a server with TLS; `None` for a server without it.
    #[must_use]
    pub fn connector(&self) -> Option<Connector> {
        self.connector.clone()
    }

    /// Sends a request with any method, content type and body.
    ///
    /// # Panics
    /// Panics if the server does not respond.
    pub async fn request(
        &self,
        method: &str,
        path: &str,
        content_type: &str,
        body: impl Into<reqwest::Body>,
    ) -> ApiResponse {
        self.try_request(method, path, content_type, body).await.expect("the server responds")
    }

    /// Sends a request to a server that may be down.
    ///
    /// # Errors
    /// Returns the client's error if the server cannot be reached or closes the connection early.
    ///
    /// # Panics
    /// Panics if `method` is not a valid HTTP method.
    pub async fn try_request(
        &self,
        method: &str,
        path: &str,
        content_type: &str,
        body: impl Into<reqwest::Body>,
    ) -> Result<ApiResponse, reqwest::Error> {
        let method = method.parse().expect("a valid method");
        let mut request =
            self.client.request(method, format!("{}{path}", self.base)).header("content-type", content_type);
        if let Some(token) = &self.token {
            request = request.bearer_auth(token);
        }
        if let Some(session) = &self.session {
            request = request.header("x-session-id", session);
        }
        let response = request.body(body).send().await?;
        let header =
            |name: &str| response.headers().get(name).and_then(|v| v.to_str().ok()).map(str::to_owned);
        let (status, kind, retry_after) =
            (response.status().as_u16(), header("content-type").unwrap_or_default(), header("retry-after"));
        let bytes = response.bytes().await?;
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let body = serde_json::from_slice(&bytes).unwrap_or(Value::String(text));
        Ok(ApiResponse { status, content_type: kind, retry_after, body })
    }

    /// Sends a GET request.
    pub async fn get(&self, path: &str) -> ApiResponse {
        self.request("GET", path, "application/json", "").await
    }

    /// Sends a POST request with a JSON body.
    pub async fn post(&self, path: &str, body: Value) -> ApiResponse {
        self.send_json("POST", path, body).await
    }

    /// Sends a JSON body with any method.
    pub async fn send_json(&self, method: &str, path: &str, body: Value) -> ApiResponse {
        self.request(method, path, "application/json", body.to_string()).await
    }

    /// Leases groups of `run`; repeats the request while the server is still preparing scenarios.
    ///
    /// # Panics
    /// Panics if the server rejects the request.
    pub async fn lease(&self, run: &str, request: Value) -> Lease {
        let path = format!("/v1/runs/{run}/leases");
        let polling = Polling::start("scenarios are prepared");
        loop {
            let response = self.post(&path, request.clone()).await;
            if response.body["type"] != "urn:sparring:problem:not_ready" {
                return Lease(response.expect(201));
            }
            polling.pause().await.expect("the server prepares scenarios");
        }
    }

    /// Reports results to `run` and returns the response with one receipt a result.
    ///
    /// # Panics
    /// Panics if the server rejects the batch.
    pub async fn report(&self, run: &str, results: Vec<Value>) -> Value {
        self.post(&format!("/v1/runs/{run}/results"), json!({ "results": results })).await.expect(200)
    }
}
