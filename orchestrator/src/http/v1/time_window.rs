//! Window of time in the query of a time series.

use env_core::text::{MAX_QUOTED_CHARS, shorten};
use sqlx::SqliteConnection;
use store::ids::RunId;
use store::runs;

use crate::http::problem::Problem;
use clock::{Millis, rfc3339};

/// Default number of points of a series.
const DEFAULT_POINTS: u32 = 300;
/// Largest number of points of a series.
const MAX_POINTS: u32 = 2000;

/// Window of a query, both ends included.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimeWindow {
    /// Start of the window.
    pub(super) from: Millis,
    /// End of the window.
    pub(super) to: Millis,
}

impl TimeWindow {
    /// Reads the fields `from` and `to` of a query. Their defaults are the start of the run and `now`.
    ///
    /// # Errors
    /// Returns a problem that names the field if a time is malformed or the window ends before it starts.
    pub(super) async fn read(
        conn: &mut SqliteConnection,
        run: &RunId,
        from: Option<&String>,
        to: Option<&String>,
        now: Millis,
    ) -> Result<Self, Problem> {
        // The clock may have been set back since the run was created.
        let created_at = runs::get(conn, run.as_str()).await?.map_or(now, |row| row.created_at.min(now));
        let window = Self { from: parse_time("from", from, created_at)?, to: parse_time("to", to, now)? };
        if window.to >= window.from {
            return Ok(window);
        }
        Err(match to {
            Some(_) => Problem::invalid("to", format!("must not be before `from`, {}", rfc3339(window.from))),
            None => {
                let reason = format!("must not be in the future, the time is {}", rfc3339(window.to));
                Problem::invalid("from", reason)
            }
        })
    }
}

/// Reads the largest number of points of a series.
///
/// # Errors
/// Returns a problem of the field `points` if it is out of range.
pub(super) fn read_points(points: Option<u32>) -> Result<u32, Problem> {
    let points = points.unwrap_or(DEFAULT_POINTS);
    if (1..=MAX_POINTS).contains(&points) {
        return Ok(points);
    }
    Err(Problem::invalid("points", format!("must be from 1 to {MAX_POINTS}, got {points}")))
}

/// Parses the time of a query field.
///
/// # Errors
/// Returns a problem of this field if the text is not an RFC 3339 time.
pub(in crate::http) fn parse_time(
    field: &'static str,
    text: Option<&String>,
    default: Millis,
) -> Result<Millis, Problem> {
    let Some(text) = text else { return Ok(default) };
    let time = text.parse::<jiff::Timestamp>().map_err(|_| {
        let text = shorten(text, MAX_QUOTED_CHARS);
        Problem::invalid(
            field,
            format!("must be an RFC 3339 time such as 2026-01-31T12:00:00Z, got {text:?}"),
        )
    })?;
    Ok(time.as_millisecond())
}
