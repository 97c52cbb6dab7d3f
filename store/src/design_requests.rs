//! Design requests: what designers were asked for, and the results. Table `design_requests`.

use sqlx::{SqliteConnection, query};

use super::{StoreError, text_enum, to_json};
use crate::Millis;

text_enum! {
    /// Kind of a designer.
    pub enum DesignerKind: "a designer" {
        /// Designed by a language model.
        Llm = "llm",
        /// The procedural designer, which samples and edits.
        Procedural = "procedural",
    }
}

text_enum! {
    /// Origin of a design request.
    pub enum RequestOrigin: "the origin of a design request" {
        /// Requested by the design worker.
        Worker = "worker",
        /// Requested by a user of the API.
        User = "user",
    }
}

text_enum! {
    /// State of a design request.
    pub enum RequestState: "the state of a design request" {
        /// The request waits for the design worker.
        Waiting = "waiting",
        /// The designer works on the request.
        Running = "running",
        /// The designer has finished.
        Done = "done",
        /// The designer failed, or the server stopped meanwhile.
        Failed = "failed",
    }
}

/// Row of the `design_requests` table.
#[derive(Debug, Clone)]
pub struct DesignRequestRow {
    /// Number of the request, from 1.
    pub id: i64,
    /// Id of the run.
    pub run: String,
    /// Task to design for.
    pub task: String,
    /// Level to design for; none before the request starts, and for strategies without levels.
    pub level: Option<i64>,
    /// The designer that was asked.
    pub designer: DesignerKind,
    /// Origin of the request: the design worker or a user.
    pub requested_by: RequestOrigin,
    /// State of the request.
    pub state: RequestState,
    /// Layouts that were requested.
    pub wanted: i64,
    /// Layouts that the gate admitted.
    pub admitted: i64,
    /// Admitted layouts of the designer that was asked, without those of its fallback.
    pub admitted_without_fallback: i64,
    /// Layouts that the gate refused.
    pub refused: i64,
    /// Name of the language model, if one was asked.
    pub model: Option<String>,
    /// Version of the model's prompt.
    pub prompt_version: Option<String>,
    /// Rounds of all designers together.
    pub rounds: i64,
    /// Number of prompt tokens.
    pub tokens_in: i64,
    /// Number of completion tokens.
    pub tokens_out: i64,
    /// Cost in the currency of the configured prices.
    pub cost: f64,
    /// Duration of it, milliseconds.
    pub latency_ms: i64,
    /// Failure profile that the request rests on, as JSON; none before the request starts.
    pub profile: Option<String>,
    /// Criticised episodes that the profile rests on.
    pub criticised: Option<i64>,
    /// Problems that did not end the request, as a JSON list of sentences.
    pub warnings: String,
    /// Why the request failed.
    pub error: Option<String>,
    /// When the request was made.
    pub created_at: Millis,
    /// When the request ended.
    pub ended_at: Option<Millis>,
}

/// A design request to be stored.
#[derive(Debug, Clone)]
pub struct NewDesignRequest {
    /// Id of the run.
    pub run: String,
    /// Task to design for.
    pub task: String,
    /// The designer to ask.
    pub designer: DesignerKind,
    /// Origin of the request: the design worker or a user.
    pub requested_by: RequestOrigin,
    /// Layouts that are requested.
    pub wanted: i64,
}

/// Result of a design request. Fields as in [`DesignRequestRow`].
#[derive(Debug, Clone, Default)]
pub struct DesignRequestResult {
    /// Layouts that the gate admitted.
    pub admitted: i64,
    /// Admitted layouts of the designer that was asked.
    pub admitted_without_fallback: i64,
    /// Layouts that the gate refused.
    pub refused: i64,
    /// Name of the language model, if one was asked.
    pub model: Option<String>,
    /// Version of the model's prompt.
    pub prompt_version: Option<String>,
    /// Rounds of all designers together.
    pub rounds: i64,
    /// Number of prompt tokens.
    pub tokens_in: i64,
    /// Number of completion tokens.
    pub tokens_out: i64,
    /// Cost in the currency of the configured prices.
    pub cost: f64,
    /// Duration of it, milliseconds.
    pub latency_ms: i64,
    /// Problems that did not end the request, one sentence each.
    pub warnings: Vec<String>,
    /// Why the request failed; none if it succeeded.
    pub error: Option<String>,
}

/// Stores a request in the state `waiting` and returns its number.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn insert(
    conn: &mut SqliteConnection,
    request: &NewDesignRequest,
    now: Millis,
) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"INSERT INTO design_requests (run, task, designer, requested_by, state, wanted, created_at)
           VALUES (?, ?, ?, ?, 'waiting', ?, ?) RETURNING id AS "id!""#,
        request.run,
        request.task,
        request.designer,
        request.requested_by,
        request.wanted,
        now
    )
    .fetch_one(conn)
    .await?)
}

/// Starts a waiting request with the profile that it rests on. Returns false if the request does not wait any more.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn start(
    conn: &mut SqliteConnection,
    id: i64,
    level: Option<i64>,
    profile: &ProfileSnapshot,
) -> Result<bool, StoreError> {
    let done = query!(
        "UPDATE design_requests SET state = 'running', level = ?, profile = ?, criticised = ?
         WHERE id = ? AND state = 'waiting'",
        level,
        profile.profile,
        profile.criticised,
        id
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected() == 1)
}

/// Ends a request that waits or runs. It failed if the result has an error. Returns false if the request was over already.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn finish(
    conn: &mut SqliteConnection,
    id: i64,
    result: &DesignRequestResult,
    now: Millis,
) -> Result<bool, StoreError> {
    let state = if result.error.is_some() { RequestState::Failed } else { RequestState::Done };
    let warnings = to_json(&result.warnings)?;
    let done = query!(
        "UPDATE design_requests SET state = ?, admitted = ?, admitted_without_fallback = ?, refused = ?, model = ?,
             prompt_version = ?, rounds = ?, tokens_in = ?, tokens_out = ?, cost = ?, latency_ms = ?, warnings = ?, error = ?,
             ended_at = ?
         WHERE id = ? AND state IN ('waiting', 'running')",
        state,
        result.admitted,
        result.admitted_without_fallback,
        result.refused,
        result.model,
        result.prompt_version,
        result.rounds,
        result.tokens_in,
        result.tokens_out,
        result.cost,
        result.latency_ms,
        warnings,
        result.error,
        now,
        id
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected() == 1)
}

/// Fails the requests that were running when the server stopped. Returns how many.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn fail_interrupted(conn: &mut SqliteConnection, now: Millis) -> Result<u64, StoreError> {
    let done = query!(
        "UPDATE design_requests SET state = 'failed', error = 'interrupted: the server went away', ended_at = ?
         WHERE state = 'running'",
        now
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected())
}

/// Selects [`DesignRequestRow`]s: takes what follows `FROM design_requests` and the arguments of the statement.
macro_rules! query_requests {
    ($rest:literal, $($argument:expr),+ $(,)?) => {
        sqlx::query_as!(
            DesignRequestRow,
            r#"SELECT id, run, task, level, designer AS "designer: DesignerKind", requested_by AS "requested_by: RequestOrigin",
                      state AS "state: RequestState", wanted, admitted, admitted_without_fallback, refused, model,
                      prompt_version, rounds, tokens_in, tokens_out, cost, latency_ms, profile, criticised, warnings, error,
                      created_at, ended_at
               FROM design_requests "# + $rest,
            $($argument),+
        )
    };
}

/// Reads a request of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get(
    conn: &mut SqliteConnection,
    run: &str,
    id: i64,
) -> Result<Option<DesignRequestRow>, StoreError> {
    Ok(query_requests!("WHERE run = ? AND id = ?", run, id).fetch_optional(conn).await?)
}

/// Filter of [`page`]; a field that is none filters nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct RequestFilter<'a> {
    /// Task to design for.
    pub task: Option<&'a str>,
    /// State of the request.
    pub state: Option<RequestState>,
}

/// Reads requests of a run with numbers below `before`, newest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn page(
    conn: &mut SqliteConnection,
    run: &str,
    filter: RequestFilter<'_>,
    before: i64,
    limit: i64,
) -> Result<Vec<DesignRequestRow>, StoreError> {
    let RequestFilter { task, state } = filter;
    Ok(query_requests!(
        "WHERE run = ?1 AND id < ?2 AND (?3 IS NULL OR task = ?3) AND (?4 IS NULL OR state = ?4)
         ORDER BY id DESC LIMIT ?5",
        run,
        before,
        task,
        state,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Totals of the requests to one designer.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignerTotals {
    /// The designer that was asked.
    pub designer: DesignerKind,
    /// Number of all requests.
    pub requests: i64,
    /// Number of failed requests.
    pub failed: i64,
    /// Number of prompt tokens.
    pub tokens_in: i64,
    /// Number of completion tokens.
    pub tokens_out: i64,
    /// Cost in the currency of the configured prices.
    pub cost: f64,
}

/// Reads the totals of a run's requests, by designer.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn totals(conn: &mut SqliteConnection, run: &str) -> Result<Vec<DesignerTotals>, StoreError> {
    Ok(sqlx::query_as!(
        DesignerTotals,
        r#"SELECT designer AS "designer!: DesignerKind", count(*) AS "requests!: i64",
                  sum(state = 'failed') AS "failed!: i64", sum(tokens_in) AS "tokens_in!: i64",
                  sum(tokens_out) AS "tokens_out!: i64", sum(cost) AS "cost!: f64"
           FROM design_requests WHERE run = ? GROUP BY designer ORDER BY designer"#,
        run
    )
    .fetch_all(conn)
    .await?)
}

/// A design request that is over.
#[derive(Debug, Clone, PartialEq)]
pub struct FinishedRequest {
    /// When the request ended.
    pub at: Millis,
    /// Admitted layouts of the designer that was asked.
    pub admitted_without_fallback: i64,
}

/// Reads the latest finished requests of a run's task, newest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn latest_finished(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    limit: i64,
) -> Result<Vec<FinishedRequest>, StoreError> {
    Ok(sqlx::query_as!(
        FinishedRequest,
        r#"SELECT coalesce(ended_at, created_at) AS "at!: i64", admitted_without_fallback FROM design_requests
           WHERE run = ? AND task = ? AND state IN ('done', 'failed') ORDER BY id DESC LIMIT ?"#,
        run,
        task,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// A failure profile at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct ProfileSnapshot {
    /// The profile as JSON.
    pub profile: String,
    /// Criticised episodes that the profile rests on.
    pub criticised: i64,
}

/// Reads the failure profile that the latest request of a run's task rests on.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn last_profile(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
) -> Result<Option<ProfileSnapshot>, StoreError> {
    Ok(sqlx::query_as!(
        ProfileSnapshot,
        r#"SELECT profile AS "profile!", criticised AS "criticised!" FROM design_requests
           WHERE run = ? AND task = ? AND profile IS NOT NULL AND criticised IS NOT NULL ORDER BY id DESC LIMIT 1"#,
        run,
        task
    )
    .fetch_optional(conn)
    .await?)
}
