//! The way to the server: requests that are made again while it is away or busy.

use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use serde_json::Value;
use ureq::Agent;
use ureq::http::{Method, Request};

use super::{failed, until};
use crate::errors::invalid;

/// How often whoever waits for an answer looks up, for one that interrupts it too.
const LOOK: Duration = Duration::from_millis(100);
/// How long one request may take.
const TIMEOUT: Duration = Duration::from_secs(60);
/// Largest answer that is read, bytes: a lease of 1 024 groups with layouts has some.
const MOST: u64 = 256 << 20;

/// Where the server is, and who asks.
pub(super) struct Link {
    agent: Agent,
    base: String,
    token: Option<String>,
}

/// Why there is no answer.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Failure {
    /// Nobody answers, or somebody who is busy or stopping: the same again may do.
    Away {
        /// In words.
        why: String,
        /// When to come again, where it says so.
        after: Option<Duration>,
    },
    /// An answer that stays the same.
    Refused {
        /// HTTP's number; 0 where nothing could be asked.
        status: u16,
        /// The field at fault.
        field: Option<String>,
        /// What the server says.
        why: String,
    },
}

impl Link {
    pub(super) fn new(url: &str, token: Option<String>) -> Self {
        let config =
            Agent::config_builder().http_status_as_error(false).timeout_global(Some(TIMEOUT)).build();
        Self { agent: config.into(), base: url.trim_end_matches('/').to_owned(), token }
    }

    pub(super) fn get(&self, path: &str) -> Result<Value, Failure> {
        self.ask(Method::GET, path, None)
    }

    pub(super) fn post(&self, path: &str, body: &Value) -> Result<Value, Failure> {
        self.ask(Method::POST, path, Some(&body.to_string()))
    }

    /// One request.
    pub(super) fn ask(&self, method: Method, path: &str, body: Option<&str>) -> Result<Value, Failure> {
        let mut request = Request::builder().method(method).uri(format!("{}{path}", self.base));
        if let Some(token) = &self.token {
            request = request.header("Authorization", format!("Bearer {token}"));
        }
        let request = match body {
            Some(body) => request.header("Content-Type", "application/json").body(body),
            None => request.body(""),
        };
        let refused = |error: &dyn std::fmt::Display| Failure::Refused {
            status: 0,
            field: None,
            why: error.to_string(),
        };
        match self.agent.run(request.map_err(|error| refused(&error))?) {
            Err(error @ (ureq::Error::BadUri(_) | ureq::Error::Http(_))) => Err(refused(&error)),
            answer => read(answer),
        }
    }
}

fn read(answer: Result<ureq::http::Response<ureq::Body>, ureq::Error>) -> Result<Value, Failure> {
    let away = |why: String| Failure::Away { why, after: None };
    let mut answer = answer.map_err(|error| away(error.to_string()))?;
    let status = answer.status().as_u16();
    let after = answer.headers().get("retry-after").and_then(|value| value.to_str().ok()?.parse().ok());
    let text = answer.body_mut().with_config().limit(MOST).read_to_string();
    let text = text.map_err(|error| away(error.to_string()))?;
    let value = serde_json::from_str::<Value>(&text);
    if (200..300).contains(&status) {
        return match value {
            Ok(value) => Ok(value),
            Err(_) if text.is_empty() => Ok(Value::Null),
            Err(error) => {
                Err(Failure::Refused { status, field: None, why: format!("no JSON came back: {error}") })
            }
        };
    }
    let problem = value.unwrap_or(Value::Null);
    let why = ["detail", "title"].iter().find_map(|field| problem[*field].as_str()).unwrap_or(&text);
    let field = problem["field"].as_str().map(str::to_owned);
    let why = match &field {
        Some(field) => format!("{field}: {why}"),
        None => why.to_owned(),
    };
    let why = why.chars().take(500).collect();
    match status {
        408 | 429 | 500..=599 => Err(Failure::Away { why, after: after.map(Duration::from_secs) }),
        _ => Err(Failure::Refused { status, field, why }),
    }
}

/// The way to a server, for what is asked now and then.
#[pyclass(frozen, module = "sparring._native")]
pub(crate) struct NativeLink(Arc<Link>);

#[pymethods]
impl NativeLink {
    #[new]
    #[pyo3(signature = (url, token=None))]
    fn new(url: &str, token: Option<String>) -> Self {
        Self(Arc::new(Link::new(url, token)))
    }

    /// Asks, again while the server is busy but not for longer than `patience_s`; JSON comes back.
    #[pyo3(signature = (method, path, body=None, *, patience_s=30.0))]
    fn ask(
        &self,
        py: Python<'_>,
        method: &str,
        path: &str,
        body: Option<&str>,
        patience_s: f64,
    ) -> PyResult<String> {
        let verb = Method::from_bytes(method.as_bytes()).map_err(|error| invalid("method", error))?;
        let until = until("patience_s", patience_s)?;
        loop {
            match self.answer(py, &verb, path, body)? {
                Ok(value) => return Ok(value.to_string()),
                Err(Failure::Refused { status: 0, why, .. }) => return Err(invalid("url", why)),
                Err(Failure::Refused { status, why, .. }) => {
                    return Err(failed(format!("{method} {path}: {status}: {why}")));
                }
                Err(Failure::Away { why, after: None }) => {
                    return Err(failed(format!("no server answers at {}: {why}", self.0.base)));
                }
                Err(Failure::Away { why, after: Some(after) }) => {
                    if Instant::now() + after > until {
                        return Err(failed(format!("{method} {path}: the server is busy: {why}")));
                    }
                    let again = Instant::now() + after;
                    while Instant::now() < again {
                        py.detach(|| std::thread::sleep(LOOK.min(after)));
                        py.check_signals()?;
                    }
                }
            }
        }
    }
}

impl NativeLink {
    /// One answer, for which a thread of its own waits: whoever asks may be interrupted.
    fn answer(
        &self,
        py: Python<'_>,
        verb: &Method,
        path: &str,
        body: Option<&str>,
    ) -> PyResult<Result<Value, Failure>> {
        let (link, verb, path) = (Arc::clone(&self.0), verb.clone(), path.to_owned());
        let (body, (tell, mut told)) = (body.map(str::to_owned), mpsc::sync_channel(1));
        let asking = std::thread::Builder::new().name("sparring-ask".to_owned());
        asking.spawn(move || {
            // Nobody waits for it any more where this fails.
            let _ = tell.send(link.ask(verb, &path, body.as_deref()));
        })?;
        loop {
            let (answer, waited) = py.detach(move || (told.recv_timeout(LOOK), told));
            told = waited;
            match answer {
                Ok(answer) => return Ok(answer),
                Err(mpsc::RecvTimeoutError::Timeout) => py.check_signals()?,
                Err(mpsc::RecvTimeoutError::Disconnected) => {
                    return Err(failed("the thread that asked failed".to_owned()));
                }
            }
        }
    }
}
