//! Client of the service for subcommands: requests, runs by name, and the event stream.
//!
//! [`connection`] finds the server that the command line means, [`run_list`] finds runs, [`event_stream`] reads events.

mod ca_args;
mod connection;
pub(crate) mod event_stream;
mod run_list;

use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use api_types::{ProblemDetails, VERSION_HEADER, check_server_version};
use reqwest::header::RETRY_AFTER;
use reqwest::{Client, Method, RequestBuilder, Response, StatusCode};
use secrecy::{ExposeSecret, SecretString};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::server_url::parse_server_url;

pub use self::ca_args::CaArgs;
pub use self::connection::{Connection, OwnService, ServerArgs, StartService, StartedService};
pub use self::event_stream::{EventStream, StreamedEvent};
pub use self::run_list::{find_run, list_runs};

/// Environment variable with the access token. A token is never an argument, because other users see arguments.
pub const TOKEN_VARIABLE: &str = "SPARRING_TOKEN";
/// Timeout of one request.
const TIMEOUT: Duration = Duration::from_secs(60);
/// How long requests to a busy service are repeated.
const RETRY_TIMEOUT: Duration = Duration::from_secs(120);
/// Longest pause between two attempts; caps Retry-After.
const MAX_PAUSE: Duration = Duration::from_secs(10);

/// Client of one service.
#[derive(Debug, Clone)]
pub struct ApiClient {
    client: Client,
    /// URL of the service without a slash at the end.
    base: String,
    token: Option<SecretString>,
}

impl ApiClient {
    /// Creates a client of the service at a URL, with the token of the environment if there is one.
    ///
    /// # Errors
    /// Returns an error if the URL is no http(s) URL, or the file of certificate authorities cannot be used.
    pub fn new(url: &str, ca: &CaArgs) -> anyhow::Result<Self> {
        let token = std::env::var(TOKEN_VARIABLE).ok().filter(|token| !token.trim().is_empty());
        Self::with_token(url, ca, token.map(|token| token.trim().into()))
    }

    fn with_token(url: &str, ca: &CaArgs, token: Option<SecretString>) -> anyhow::Result<Self> {
        let parsed =
            parse_server_url(url, &["http", "https"]).map_err(|reason| anyhow!("--url: {reason}"))?;
        let builder =
            llm::http_client_builder(ca.roots(parsed.scheme() == "https")).map_err(anyhow::Error::msg)?;
        let client = builder.connect_timeout(TIMEOUT).build()?;
        Ok(Self { client, base: url.trim_end_matches('/').to_owned(), token })
    }

    /// Returns the URL of the service.
    pub fn url(&self) -> &str {
        &self.base
    }

    /// Reads a resource; `path` begins with a slash.
    ///
    /// # Errors
    /// Returns an error if the service cannot be reached, rejects the request, stays busy, or sends an unexpected body.
    pub async fn get<A: DeserializeOwned>(&self, path: &str) -> anyhow::Result<A> {
        self.send(Method::GET, path, None::<&()>).await
    }

    /// Reads a resource as text.
    ///
    /// # Errors
    /// Returns the errors of [`ApiClient::get`].
    pub async fn get_text(&self, path: &str) -> anyhow::Result<String> {
        let response = self.respond(Method::GET, path, None::<&()>).await?;
        response.text().await.with_context(|| format!("GET {}{path}", self.base))
    }

    /// Sends a POST request.
    ///
    /// # Errors
    /// Returns the errors of [`ApiClient::get`].
    pub async fn post<A: DeserializeOwned>(&self, path: &str, body: &impl Serialize) -> anyhow::Result<A> {
        self.send(Method::POST, path, Some(body)).await
    }

    /// Sends a POST request once, with a header.
    ///
    /// # Errors
    /// Returns an error if the service cannot be reached, rejects the request, or sends an unexpected body.
    pub async fn post_with_header<A: DeserializeOwned>(
        &self,
        path: &str,
        header: &str,
        value: &str,
        body: &impl Serialize,
    ) -> anyhow::Result<A> {
        let request = self.request(&Method::POST, path).header(header, value).json(body);
        let response = self.received(request.send().await)?;
        if response.status().is_success() {
            self.read(path, response).await
        } else {
            Err(self.rejected(response).await)
        }
    }

    /// Sends a POST request without a body.
    ///
    /// # Errors
    /// Returns the errors of [`ApiClient::get`].
    pub async fn post_empty<A: DeserializeOwned>(&self, path: &str) -> anyhow::Result<A> {
        self.send(Method::POST, path, None::<&()>).await
    }

    /// Sends a PUT request.
    ///
    /// # Errors
    /// Returns the errors of [`ApiClient::get`].
    pub(crate) async fn put<A: DeserializeOwned>(
        &self,
        path: &str,
        body: &impl Serialize,
    ) -> anyhow::Result<A> {
        self.send(Method::PUT, path, Some(body)).await
    }

    /// Sends a DELETE request with a query.
    ///
    /// # Errors
    /// Returns the errors of [`ApiClient::get`].
    pub(crate) async fn delete<A: DeserializeOwned>(
        &self,
        path: &str,
        query: &[(&str, &str)],
    ) -> anyhow::Result<A> {
        self.send(Method::DELETE, &with_query(path, query), None::<&()>).await
    }

    async fn send<A: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        body: Option<&impl Serialize>,
    ) -> anyhow::Result<A> {
        let response = self.respond(method, path, body).await?;
        self.read(path, response).await
    }

    /// Reads the body of a response.
    async fn read<A: DeserializeOwned>(&self, path: &str, response: Response) -> anyhow::Result<A> {
        let bytes = response.bytes().await;
        let bytes = bytes.with_context(|| format!("the connection to {} broke", self.base))?;
        serde_json::from_slice(&bytes).with_context(|| {
            format!("{}{path}: the response is not that of a Sparring server of this version", self.base)
        })
    }

    /// Sends a request. If the service is busy, waits as long as Retry-After says and repeats it. All requests of the command
    /// line may be repeated: reports are idempotent, and an unused lease expires.
    async fn respond(
        &self,
        method: Method,
        path: &str,
        body: Option<&impl Serialize>,
    ) -> anyhow::Result<Response> {
        let until = Instant::now() + RETRY_TIMEOUT;
        loop {
            let mut request = self.request(&method, path);
            if let Some(body) = body {
                request = request.json(body);
            }
            let response = self.received(request.send().await)?;
            let status = response.status();
            if status.is_success() {
                return Ok(response);
            }
            let is_busy = matches!(status, StatusCode::TOO_MANY_REQUESTS | StatusCode::SERVICE_UNAVAILABLE);
            if is_busy && Instant::now() < until {
                let after = response.headers().get(RETRY_AFTER).and_then(|value| value.to_str().ok());
                tokio::time::sleep(pause(after)).await;
                continue;
            }
            return Err(self.rejected(response).await);
        }
    }

    /// Begins a request with the token and the timeout.
    fn request(&self, method: &Method, path: &str) -> RequestBuilder {
        let request = self.client.request(method.clone(), format!("{}{path}", self.base)).timeout(TIMEOUT);
        match &self.token {
            Some(token) => request.bearer_auth(token.expose_secret()),
            None => request,
        }
    }

    /// Opens the event stream of a run, which has no timeout.
    async fn open_stream(&self, path: &str, last_id: Option<&str>) -> anyhow::Result<Response> {
        let mut request = self.client.get(format!("{}{path}", self.base));
        if let Some(token) = &self.token {
            request = request.bearer_auth(token.expose_secret());
        }
        if let Some(id) = last_id {
            request = request.header("last-event-id", id);
        }
        let response = self.received(request.send().await)?;
        if response.status().is_success() { Ok(response) } else { Err(self.rejected(response).await) }
    }

    /// Returns a response of a server whose version works with this one.
    fn received(&self, response: reqwest::Result<Response>) -> anyhow::Result<Response> {
        let response = response.map_err(|error| self.unreachable(error))?;
        if let Some(version) = response.headers().get(VERSION_HEADER) {
            check_server_version(&String::from_utf8_lossy(version.as_bytes()))
                .map_err(|reason| anyhow!("{}: {reason}", self.base))?;
        }
        Ok(response)
    }

    fn unreachable(&self, error: reqwest::Error) -> anyhow::Error {
        if let Some(reason) = certificate_problem(&error) {
            anyhow!(
                "the certificate of the server at {} is not accepted: {reason}; set --ca to its certificate authority, and --url to a name in the certificate",
                self.base
            )
        } else if error.is_connect() {
            anyhow!(
                "no server responds at {}: start one with `sparring serve`, or set --url to its address",
                self.base
            )
        } else if error.is_timeout() {
            anyhow!("the server at {} did not respond within {} s", self.base, TIMEOUT.as_secs())
        } else {
            anyhow!(error.without_url()).context(format!("request to {}", self.base))
        }
    }

    async fn rejected(&self, response: Response) -> anyhow::Error {
        let status = response.status();
        let problem: ProblemDetails = response
            .bytes()
            .await
            .ok()
            .and_then(|body| serde_json::from_slice(&body).ok())
            .unwrap_or_default();
        match status {
            StatusCode::UNAUTHORIZED if self.token.is_some() => {
                anyhow!(
                    "the server at {} rejects the token in {TOKEN_VARIABLE}: {}",
                    self.base,
                    problem.message()
                )
            }
            StatusCode::UNAUTHORIZED => anyhow!(
                "the server at {} needs a token: set {TOKEN_VARIABLE}; `sparring token create` creates one",
                self.base
            ),
            _ if problem.detail.is_empty() => anyhow!("{} ({status})", problem.message_with_field()),
            _ => anyhow!(problem.message_with_field()),
        }
    }
}

/// Returns the reason why a TLS handshake failed, if that is the cause of an error.
fn certificate_problem(error: &(dyn std::error::Error + 'static)) -> Option<String> {
    if let Some(error) = error.downcast_ref::<rustls::Error>() {
        return Some(error.to_string());
    }
    // An I/O error may hold the error of the TLS library without having it as its source.
    match error.downcast_ref::<std::io::Error>().and_then(std::io::Error::get_ref) {
        Some(inner) => certificate_problem(inner),
        None => certificate_problem(error.source()?),
    }
}

/// Returns a path with an encoded query.
pub(crate) fn with_query(path: &str, query: &[(&str, &str)]) -> String {
    let encoded = reqwest::Url::parse_with_params("http://localhost", query);
    let encoded = encoded.ok().and_then(|url| url.query().map(str::to_owned)).unwrap_or_default();
    format!("{path}?{encoded}")
}

/// Returns the pause before the next attempt: Retry-After in seconds, or one second if the header is missing or invalid.
fn pause(retry_after: Option<&str>) -> Duration {
    let seconds = retry_after.and_then(|text| text.trim().parse().ok()).unwrap_or(1);
    Duration::from_secs(seconds).clamp(Duration::from_millis(100), MAX_PAUSE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_are_bounded() {
        assert_eq!(pause(Some("2")), Duration::from_secs(2));
        assert_eq!(pause(Some("0")), Duration::from_millis(100));
        assert_eq!(pause(Some("3600")), MAX_PAUSE);
        assert_eq!(pause(Some("Wed, 21 Oct 2026 07:28:00 GMT")), Duration::from_secs(1));
        assert_eq!(pause(None), Duration::from_secs(1));
    }

    #[test]
    fn query_is_encoded() {
        let path = with_query("/v1/runs/a", &[("name", "b & c = 100 %"), ("tag", "lr:1")]);
        assert_eq!(path, "/v1/runs/a?name=b+%26+c+%3D+100+%25&tag=lr%3A1");
    }

    #[test]
    fn urls_are_checked() {
        for wrong in
            ["nonsense", "ftp://host", "127.0.0.1:8700", "", "http://user:word@h:1", "http://h:1/?a=b"]
        {
            let error = format!("{:#}", ApiClient::with_token(wrong, &CaArgs::default(), None).unwrap_err());
            assert!(error.starts_with("--url: "), "{error}");
        }
        assert_eq!(
            ApiClient::with_token("http://h:1/", &CaArgs::default(), None).unwrap().url(),
            "http://h:1"
        );
    }
}
