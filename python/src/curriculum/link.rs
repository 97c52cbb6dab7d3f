//! The way to the server: requests that are made again while it is away or busy.

use std::net::IpAddr;
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use serde_json::Value;
use ureq::Agent;
use ureq::http::{Method, Request, Uri};

use super::{failed, until};
use crate::errors::invalid;

/// How often whoever waits for an answer looks up, for one that interrupts it too.
const LOOK: Duration = Duration::from_millis(100);
/// How long one request may take.
const TIMEOUT: Duration = Duration::from_secs(60);
/// Longest that the server is waited for because it says so.
const LONGEST: Duration = Duration::from_secs(600);
/// The word of a server that was too slow: whether it did what was asked is not known.
const TIMED_OUT: &str = "timed_out";
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
        /// HTTP's number, where there was an answer.
        status: Option<u16>,
        /// The word for programs.
        kind: Option<String>,
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
        /// The word for programs.
        kind: Option<String>,
        /// What the server says.
        why: String,
    },
}

impl Link {
    pub(super) fn new(url: &str, token: Option<String>) -> Self {
        let config = Agent::config_builder().http_status_as_error(false).timeout_global(Some(TIMEOUT));
        // What is on this machine no proxy finds.
        let config = if is_local(url) { config.proxy(None) } else { config };
        Self { agent: config.build().into(), base: url.trim_end_matches('/').to_owned(), token }
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
            kind: None,
            why: error.to_string(),
        };
        match self.agent.run(request.map_err(|error| refused(&error))?) {
            Err(error @ (ureq::Error::BadUri(_) | ureq::Error::Http(_))) => Err(refused(&error)),
            answer => read(answer),
        }
    }
}

/// Whether an address is of this machine itself.
#[pyfunction]
pub(crate) fn is_local(url: &str) -> bool {
    let Some(host) = url.parse::<Uri>().ok().and_then(|uri| uri.host().map(str::to_ascii_lowercase)) else {
        return false;
    };
    let address = host.trim_matches(['[', ']']).parse::<IpAddr>();
    host == "localhost" || address.is_ok_and(|address| address.is_loopback())
}

fn read(answer: Result<ureq::http::Response<ureq::Body>, ureq::Error>) -> Result<Value, Failure> {
    let away = |why: String| Failure::Away { status: None, kind: None, why, after: None };
    let mut answer = answer.map_err(|error| away(error.to_string()))?;
    let status = answer.status().as_u16();
    let after =
        answer.headers().get("retry-after").and_then(|value| value.to_str().ok()?.parse::<u64>().ok());
    let text = answer.body_mut().with_config().limit(MOST).read_to_string();
    let text = text.map_err(|error| away(error.to_string()))?;
    let value = serde_json::from_str::<Value>(&text);
    if (200..300).contains(&status) {
        return match value {
            Ok(value) => Ok(value),
            Err(_) if text.is_empty() => Ok(Value::Null),
            Err(error) => {
                let why = format!("no JSON came back: {error}");
                Err(Failure::Refused { status, field: None, kind: None, why })
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
    let kind = problem["type"].as_str().and_then(|kind| kind.rsplit(':').next()).map(str::to_owned);
    match status {
        408 | 429 | 500..=599 => {
            let after = after.map(|seconds| Duration::from_secs(seconds).min(LONGEST));
            Err(Failure::Away { status: Some(status), kind, why, after })
        }
        _ => Err(Failure::Refused { status, field, kind, why }),
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

    /// Asks, again while the server is busy but not for longer than `patience_s`, nor where it may have done what is not to be
    /// done twice; JSON comes back. With `wait` one that does not answer may come back, too, and is only looked at by then.
    #[pyo3(signature = (method, path, body=None, *, patience_s=30.0, wait=false))]
    fn ask(
        &self,
        py: Python<'_>,
        method: &str,
        path: &str,
        body: Option<&str>,
        patience_s: f64,
        wait: bool,
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
                Err(Failure::Away { status: None, .. })
                    if wait && verb == Method::GET && Instant::now() < until =>
                {
                    py.detach(|| std::thread::sleep(LOOK));
                    py.check_signals()?;
                }
                Err(Failure::Away { status: None, why, .. }) => {
                    return Err(failed(format!("no server answers at {}: {why}", self.0.base)));
                }
                Err(Failure::Away { status: Some(status), kind, why, after }) => {
                    // What may have been done must not be done twice.
                    let undone = verb == Method::GET || kind.is_some_and(|kind| kind != TIMED_OUT);
                    let after = after.filter(|after| undone && Instant::now() + *after <= until);
                    let Some(after) = after else {
                        return Err(failed(format!("{method} {path}: {status}: {why}")));
                    };
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
