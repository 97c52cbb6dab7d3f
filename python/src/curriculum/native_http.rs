//! `NativeHttpClient`: single requests to a server from Python.

use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::Value;
use ureq::http::Method;

use super::error::{curriculum_error, deadline};
use super::http_client::{HttpClient, RequestError, TIMED_OUT, is_loopback_url};
use crate::errors::{invalid, rejected};
use api_types::check_server_version;

/// Interval at which a waiting thread lets Python handle signals.
const REQUEST_POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Returns true if the host of a URL is this machine.
#[pyfunction]
pub(crate) fn is_loopback(url: &str) -> bool {
    is_loopback_url(url)
}

/// Returns the reason why a client of this version does not work with a server; None if it does. `version` is the header
/// `sparring-version` of the server.
#[pyfunction]
pub(crate) fn server_version_problem(version: &str) -> Option<String> {
    check_server_version(version).err()
}

/// HTTP client for single requests to a server.
#[pyclass(frozen, module = "sparring._native")]
pub(crate) struct NativeHttpClient(Arc<HttpClient>);

#[pymethods]
impl NativeHttpClient {
    #[new]
    #[pyo3(signature = (url, token=None))]
    fn new(url: &str, token: Option<String>) -> PyResult<Self> {
        let client = HttpClient::new(url, token).map_err(PyValueError::new_err)?;
        Ok(Self(Arc::new(client)))
    }

    /// Sends a request and returns the JSON of the response.
    ///
    /// Repeats it for at most `max_wait_s` seconds while the server is busy, unless the server may have executed a request
    /// that is not safe to repeat. With `wait_for_server`, a GET is also repeated while the server does not answer at all.
    #[pyo3(signature = (method, path, body=None, *, max_wait_s=30.0, wait_for_server=false))]
    fn request(
        &self,
        py: Python<'_>,
        method: &str,
        path: &str,
        body: Option<&str>,
        max_wait_s: f64,
        wait_for_server: bool,
    ) -> PyResult<String> {
        let verb =
            Method::from_bytes(method.as_bytes()).map_err(|_| invalid("method", "an HTTP method", method))?;
        let until = deadline("max_wait_s", max_wait_s)?;
        loop {
            match self.send(py, &verb, path, body)? {
                Ok(value) => return Ok(value.to_string()),
                Err(RequestError::Rejected { status: 0, message, .. }) => {
                    return Err(rejected("url", message));
                }
                Err(RequestError::Rejected { status, message, .. }) => {
                    return Err(curriculum_error(format!("{method} {path}: {status}: {message}")));
                }
                Err(RequestError::Unavailable { status: None, .. })
                    if wait_for_server && verb == Method::GET && Instant::now() < until =>
                {
                    sleep(py, REQUEST_POLL_INTERVAL)?;
                }
                Err(RequestError::Unavailable { status: None, message, .. }) => {
                    let url = self.0.base_url();
                    return Err(curriculum_error(format!(
                        "no server answers at {url}: {message}; start one with `sparring serve`"
                    )));
                }
                Err(RequestError::Unavailable { status: Some(status), kind, message, retry_after }) => {
                    // A request that the server may have executed must not be executed twice.
                    let is_repeatable = verb == Method::GET || kind.is_some_and(|kind| kind != TIMED_OUT);
                    let delay = retry_after.filter(|delay| is_repeatable && Instant::now() + *delay <= until);
                    let Some(delay) = delay else {
                        return Err(curriculum_error(format!("{method} {path}: {status}: {message}")));
                    };
                    sleep(py, delay)?;
                }
            }
        }
    }
}

impl NativeHttpClient {
    /// Sends one request in a separate thread, so that this thread can handle Python signals while it waits.
    fn send(
        &self,
        py: Python<'_>,
        method: &Method,
        path: &str,
        body: Option<&str>,
    ) -> PyResult<Result<Value, RequestError>> {
        let (client, method, path) = (Arc::clone(&self.0), method.clone(), path.to_owned());
        let body = body.map(str::to_owned);
        let (sender, mut receiver) = mpsc::sync_channel(1);
        let thread = std::thread::Builder::new().name("sparring-request".to_owned());
        thread.spawn(move || {
            // Sending fails only if the caller was interrupted.
            let _ = sender.send(client.send(method, &path, body.as_deref()));
        })?;
        loop {
            let (response, returned) =
                py.detach(move || (receiver.recv_timeout(REQUEST_POLL_INTERVAL), receiver));
            receiver = returned;
            match response {
                Ok(response) => return Ok(response),
                Err(mpsc::RecvTimeoutError::Timeout) => py.check_signals()?,
                Err(mpsc::RecvTimeoutError::Disconnected) => {
                    return Err(curriculum_error(
                        "the thread of the request ended without a response".to_owned(),
                    ));
                }
            }
        }
    }
}

/// Sleeps in short intervals, so that Python can handle signals.
fn sleep(py: Python<'_>, duration: Duration) -> PyResult<()> {
    let until = Instant::now() + duration;
    while Instant::now() < until {
        py.detach(|| std::thread::sleep(REQUEST_POLL_INTERVAL.min(duration)));
        py.check_signals()?;
    }
    Ok(())
}
