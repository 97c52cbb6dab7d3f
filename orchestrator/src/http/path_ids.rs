//! Ids in paths and queries.

use std::str::FromStr;

use axum::http::StatusCode;
use store::ids::{InvalidId, RunId};

use super::problem::Problem;

/// Parses the id of a run in a path.
///
/// # Errors
/// Returns a problem with status 400 if the text is no id of a run.
pub(super) fn parse_run_id(text: &str) -> Result<RunId, Problem> {
    parse_id("run", text)
}

/// Parses an id in a path or query; `field` is its name.
///
/// # Errors
/// Returns a problem with status 400 that names the field if the text is no such id.
pub(super) fn parse_id<T: FromStr<Err = InvalidId>>(field: &str, text: &str) -> Result<T, Problem> {
    text.parse().map_err(|error: InvalidId| {
        Problem::new(StatusCode::BAD_REQUEST, "bad_id", error.to_string()).at(field)
    })
}
