//! HTTP requests to the server.

use std::net::IpAddr;
use std::path::Path;
use std::time::Duration;

use api_types::{VERSION_HEADER, check_server_version};
use serde_json::Value;
use ureq::Agent;
use ureq::http::{Method, Request, Uri};
use ureq::tls::{PemItem, RootCerts, TlsConfig, parse_pem};

/// Environment variable with the file of certificate authorities to trust.
const CA_FILE_VARIABLE: &str = "SPARRING_CA_FILE";
/// Timeout of one request.
const TIMEOUT: Duration = Duration::from_secs(60);
/// Delay before a repeated request if the response has no `Retry-After` header.
pub(super) const RETRY_DELAY: Duration = Duration::from_secs(1);
/// Maximum delay that a `Retry-After` header can impose.
const MAX_RETRY_AFTER: Duration = Duration::from_secs(600);
/// Problem type of a request that the server gave up: the client cannot know whether it was executed.
pub(super) const TIMED_OUT: &str = "timed_out";
/// Maximum size of a response, bytes; a lease of 1 024 groups with layouts has many megabytes.
const MAX_RESPONSE_BYTES: u64 = 256 << 20;
/// Maximum length of an error message, characters.
const MAX_MESSAGE_CHARS: usize = 500;

/// Client of one server, with the caller's token.
pub(super) struct HttpClient {
    agent: Agent,
    base_url: String,
    token: Option<String>,
}

/// Reason why a request has no successful response.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum RequestError {
    /// The server does not answer, is busy or is stopping; the same request may succeed later.
    Unavailable {
        /// HTTP status, if there was a response.
        status: Option<u16>,
        /// Last part of the problem type.
        kind: Option<String>,
        /// Message for the user.
        message: String,
        /// Delay that the `Retry-After` header of the response requests.
        retry_after: Option<Duration>,
    },
    /// The server rejects the request, and would reject it again.
    Rejected {
        /// HTTP status; 0 if the request could not be built.
        status: u16,
        /// Path of the invalid field, if the server names one.
        field: Option<String>,
        /// Last part of the problem type.
        kind: Option<String>,
        /// Message for the user.
        message: String,
    },
}

impl HttpClient {
    /// Creates a client; a server on this machine is reached without a proxy. The variable `SPARRING_CA_FILE` names the
    /// certificate authorities of a server with TLS.
    ///
    /// # Errors
    /// Returns a message if the file of `SPARRING_CA_FILE` cannot be used.
    pub(super) fn new(url: &str, token: Option<String>) -> Result<Self, String> {
        let config = Agent::config_builder().http_status_as_error(false).timeout_global(Some(TIMEOUT));
        let config = if is_loopback_url(url) { config.proxy(None) } else { config };
        let config = match std::env::var_os(CA_FILE_VARIABLE).filter(|file| !file.is_empty()) {
            Some(file) => config.tls_config(tls_config(file.as_ref())?),
            None => config,
        };
        Ok(Self { agent: config.build().into(), base_url: url.trim_end_matches('/').to_owned(), token })
    }

    /// Address of the server.
    pub(super) fn base_url(&self) -> &str {
        &self.base_url
    }

    /// Sends a GET request; returns the JSON of the response.
    ///
    /// # Errors
    /// See [`RequestError`].
    pub(super) fn get(&self, path: &str) -> Result<Value, RequestError> {
        self.send(Method::GET, path, None)
    }

    /// Sends a POST request; returns the JSON of the response.
    ///
    /// # Errors
    /// See [`RequestError`].
    pub(super) fn post(&self, path: &str, body: &Value) -> Result<Value, RequestError> {
        self.send(Method::POST, path, Some(&body.to_string()))
    }

    /// Sends one request; returns the JSON of the response.
    ///
    /// # Errors
    /// See [`RequestError`].
    pub(super) fn send(&self, method: Method, path: &str, body: Option<&str>) -> Result<Value, RequestError> {
        let mut request = Request::builder().method(method).uri(format!("{}{path}", self.base_url));
        if let Some(token) = &self.token {
            request = request.header("Authorization", format!("Bearer {token}"));
        }
        let request = match body {
            Some(body) => request.header("Content-Type", "application/json").body(body),
            None => request.body(""),
        };
        let invalid_request = |error: &dyn std::fmt::Display| RequestError::Rejected {
            status: 0,
            field: None,
            kind: None,
            message: error.to_string(),
        };
        match self.agent.run(request.map_err(|error| invalid_request(&error))?) {
            Err(error @ (ureq::Error::BadUri(_) | ureq::Error::Http(_))) => Err(invalid_request(&error)),
            response => read_response(response),
        }
    }
}

/// Returns TLS settings that trust only the certificate authorities of a PEM file.
fn tls_config(file: &Path) -> Result<TlsConfig, String> {
    let unusable = |reason: &dyn std::fmt::Display| {
        format!("{CA_FILE_VARIABLE}: the file {} cannot be used: {reason}", file.display())
    };
    let pem = std::fs::read(file).map_err(|error| unusable(&error))?;
    let mut roots = Vec::new();
    for item in parse_pem(&pem) {
        if let PemItem::Certificate(certificate) = item.map_err(|error| unusable(&error))? {
            roots.push(certificate);
        }
    }
    if roots.is_empty() {
        return Err(unusable(&"it has no certificate in PEM format"));
    }
    Ok(TlsConfig::builder().root_certs(RootCerts::new_with_certs(&roots)).build())
}

/// True if the host of a URL is this machine.
pub(super) fn is_loopback_url(url: &str) -> bool {
    let Some(host) = url.parse::<Uri>().ok().and_then(|uri| uri.host().map(str::to_ascii_lowercase)) else {
        return false;
    };
    let address = host.trim_matches(['[', ']']).parse::<IpAddr>();
    host == "localhost" || address.is_ok_and(|address| address.is_loopback())
}

fn read_response(
    response: Result<ureq::http::Response<ureq::Body>, ureq::Error>,
) -> Result<Value, RequestError> {
    let no_response = |error: ureq::Error| RequestError::Unavailable {
        status: None,
        kind: None,
        message: error.to_string(),
        retry_after: None,
    };
    let mut response = response.map_err(no_response)?;
    let status = response.status().as_u16();
    // A server without the header is no server of this project, or a proxy answers for it.
    if let Some(version) = response.headers().get(VERSION_HEADER) {
        check_server_version(&String::from_utf8_lossy(version.as_bytes()))
            .map_err(|message| RequestError::Rejected { status, field: None, kind: None, message })?;
    }
    let header = response.headers().get("retry-after");
    let retry_after = header.and_then(|value| value.to_str().ok()?.parse::<u64>().ok());
    let text = response.body_mut().with_config().limit(MAX_RESPONSE_BYTES).read_to_string();
    let text = text.map_err(no_response)?;
    let value = serde_json::from_str::<Value>(&text);
    if !(200..300).contains(&status) {
        return Err(read_problem(status, retry_after, &value.unwrap_or(Value::Null), &text));
    }
    match value {
        Ok(value) => Ok(value),
        Err(_) if text.is_empty() => Ok(Value::Null),
        Err(error) => {
            let message =
                format!("the response is not JSON: {error}; check that the URL is that of a sparring server");
            Err(RequestError::Rejected { status, field: None, kind: None, message })
        }
    }
}

/// Reads an error response: problem details (RFC 9457), or any other text.
fn read_problem(status: u16, retry_after: Option<u64>, problem: &Value, text: &str) -> RequestError {
    let detail = ["detail", "title"].iter().find_map(|name| problem[*name].as_str()).unwrap_or(text);
    let field = problem["field"].as_str().map(str::to_owned);
    let message = match &field {
        Some(field) => format!("{field}: {detail}"),
        None => detail.to_owned(),
    };
    let message = message.chars().take(MAX_MESSAGE_CHARS).collect();
    let kind = problem["type"].as_str().and_then(|kind| kind.rsplit(':').next()).map(str::to_owned);
    match status {
        408 | 429 | 500..=599 => {
            let retry_after = retry_after.map(|seconds| Duration::from_secs(seconds).min(MAX_RETRY_AFTER));
            RequestError::Unavailable { status: Some(status), kind, message, retry_after }
        }
        _ => RequestError::Rejected { status, field, kind, message },
    }
}
