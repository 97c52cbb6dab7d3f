//! Private parsers of requests, for fuzz tests only. They are not behind a feature, because a feature would compile the crate
//! twice: for the program and for the tests.

use axum::Router;
use axum::body::{Body, Bytes};
use axum::http::{Request, header};
use axum::middleware::from_fn;
use axum::response::IntoResponse;
use axum::routing::post;
use hyper::service::Service;
use hyper_util::service::TowerToHyperService;
use serde_json::Value;
use store::events::EventKind;

use super::content_encoding;
pub use super::extract::BodyFormat;
use super::extract::{BodyClass, EncodedBody};
use super::openenv::fields::{FieldReader, read_session_request};
use super::openenv::mcp::rpc::RpcRequest;
use super::paging::PageCursor;
use super::problem::Problem;
use super::v1::columns::read_columns;
use super::v1::events::parse_kinds;
use super::v1::results::read_report;
use super::v1::sessions::open::{ClientMessage, parse_message};
use super::v1::sessions::session_request::{session_request, vector_request};
use super::v1::time_window::parse_time;
use crate::results::columns::table::Columns;
use crate::results::reported::ReportedEpisode;
use crate::sessions::SessionRequest;

/// Error response to a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rejection {
    /// HTTP status of the response.
    pub status: u16,
    /// Detail, with the field if there is one.
    pub message: String,
}

impl From<Problem> for Rejection {
    fn from(problem: Problem) -> Self {
        Self { status: problem.status().as_u16(), message: problem.message() }
    }
}

fn body(format: BodyFormat, bytes: &[u8]) -> EncodedBody {
    EncodedBody { format, bytes: Bytes::copy_from_slice(bytes), class: BodyClass::Bulk }
}

/// Parses a body of columns.
///
/// # Errors
/// Returns the error response.
pub fn columns(format: BodyFormat, bytes: &[u8]) -> Result<Columns, Rejection> {
    let (_, columns) = read_columns(body(format, bytes))?;
    Ok(columns)
}

/// Parses a body of results.
///
/// # Errors
/// Returns the error response.
pub fn results(format: BodyFormat, bytes: &[u8]) -> Result<Vec<ReportedEpisode>, Rejection> {
    let (_, episodes) = read_report(body(format, bytes))?;
    Ok(episodes)
}

/// Parses a message of a session and, if it opens one, the request in it.
///
/// # Errors
/// Returns the error message as JSON.
pub fn session_message(text: &str) -> Result<(), Vec<u8>> {
    let message = parse_message(text).map_err(|(id, error)| error.to_json(id))?;
    let ClientMessage { kind, id, mut fields } = message;
    if kind == "open" {
        fields.remove("version");
        fields.remove("id");
        if let Some(vector) = fields.remove("vector").filter(|vector| !vector.is_null()) {
            vector_request(vector).map_err(|error| error.to_json(id))?;
        }
        session_request(fields).map_err(|error| error.to_json(id))?;
    }
    Ok(())
}

/// Parses the data of an OpenEnv reset.
///
/// # Errors
/// Returns the validation errors as JSON.
pub fn reset_request(value: &Value) -> Result<SessionRequest, Vec<Value>> {
    let Some(fields) = value.as_object() else { return Err(Vec::new()) };
    let mut reader = FieldReader::new(fields, Vec::new());
    let request = read_session_request(&mut reader);
    if reader.errors.is_empty() {
        Ok(request)
    } else {
        Err(reader.errors.iter().map(|error| serde_json::json!(error)).collect())
    }
}

/// Parses a JSON-RPC request and returns its method.
///
/// # Errors
/// Returns the error.
pub fn rpc_method(value: &Value) -> Result<String, String> {
    RpcRequest::parse(value).map(|request| request.method).map_err(|error| format!("{error:?}"))
}

/// Parses the cursor of a page and writes it again.
///
/// # Errors
/// Returns the error response.
pub fn cursor(text: &str) -> Result<String, Rejection> {
    let cursor = PageCursor::parse(Some(text))?.unwrap_or_default();
    Ok(format!("{}.{}", cursor.number, cursor.text))
}

/// Parses a list of event kinds.
///
/// # Errors
/// Returns the error response.
pub fn event_kinds(text: &str) -> Result<Vec<EventKind>, Rejection> {
    Ok(parse_kinds(Some(text))?)
}

/// Parses the time of a query, in milliseconds since 1970 UTC.
///
/// # Errors
/// Returns the error response.
pub fn time(text: &str) -> Result<i64, Rejection> {
    Ok(parse_time("from", Some(&text.to_owned()), 0)?)
}

/// Receives a body as the server does, decompressed if it has gzip's encoding, and parses it within the limits of ordinary
/// requests. Must be called within a Tokio runtime.
///
/// # Errors
/// Returns the status of the error response.
pub async fn receive(content_type: &str, is_gzip: bool, bytes: &[u8]) -> Result<(), u16> {
    async fn parse(body: EncodedBody) -> Result<(), Problem> {
        body.parse().map(|_| ())
    }
    let router = Router::new().route("/", post(parse)).layer(from_fn(content_encoding::decompress));
    let mut request = Request::post("/").header(header::CONTENT_TYPE, content_type);
    if is_gzip {
        request = request.header(header::CONTENT_ENCODING, "gzip");
    }
    let request = request.body(Body::from(bytes.to_vec())).map_err(|_| 0_u16)?;
    let Ok(response) = TowerToHyperService::new(router).call(request).await;
    let status = response.into_response().status();
    if status.is_success() { Ok(()) } else { Err(status.as_u16()) }
}
