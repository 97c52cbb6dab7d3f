//! Reported episodes and their action logs. Tables `episodes` and `action_logs`.

use std::collections::HashMap;

use env_core::ActionLog;
use sqlx::{QueryBuilder, SqliteConnection, query};

use super::keys::{EpisodeKey, EpisodeSpan};
use super::pack::{pack, unpack};
use super::{MAX_ROWS, StoreError, digest, text_enum, to_json};
use crate::Millis;

text_enum! {
    /// State of a reported episode.
    pub enum EpisodeState: "an episode's state" {
        /// The episode ran to its end.
        Finished = "finished",
        /// The infrastructure lost the episode.
        Failed = "failed",
        /// The result arrived after the lease had ended.
        Late = "late",
    }
}

/// Row of the `episodes` table.
#[derive(Debug, Clone)]
pub struct EpisodeRow {
    /// Number of the lease.
    pub lease: i64,
    /// Index of the episode in the lease.
    pub number: i64,
    /// State of the episode.
    pub state: EpisodeState,
    /// Digest of the reported result.
    pub digest: Vec<u8>,
    /// The world's score, from replay.
    pub score: Option<f64>,
    /// True if the episode is a success by the run's rule.
    pub success: Option<bool>,
    /// Skill, if the scenario defines one.
    pub skill: Option<f64>,
    /// Floor of the bracket.
    pub floor: Option<f64>,
    /// Reference score of the bracket.
    pub reference: Option<f64>,
    /// Version of the bracket's planner.
    pub planner_version: Option<i64>,
    /// Outcome ([`super::brackets::StoredOutcome`]) as JSON; none if the episode was not run.
    pub outcome: Option<String>,
    /// Version of the policy that ran the episode.
    pub policy_version: i64,
    /// Why the episode failed.
    pub reason: Option<String>,
    /// Metrics that the trainer logged, as JSON.
    pub metrics: Option<String>,
    /// When the result was reported.
    pub at: Millis,
}

impl EpisodeRow {
    /// Key of the episode.
    #[must_use]
    pub const fn key(&self) -> EpisodeKey {
        EpisodeKey { lease: self.lease, number: self.number }
    }
}

/// An action log as it is stored.
#[derive(Debug, Clone)]
pub struct StoredLog {
    /// Digest of the encoded log, to tell a repeated report from a contradicting one.
    pub digest: [u8; 16],
    body: Vec<u8>,
}

impl StoredLog {
    /// Encodes and compresses a log. This takes a while: do not call it in the writer.
    #[must_use]
    pub fn of(log: &ActionLog) -> Self {
        let encoded = log.encode();
        Self { digest: digest(&encoded), body: pack(encoded) }
    }
}

/// Stores episodes, with the action logs of those that were run.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn insert(
    conn: &mut SqliteConnection,
    rows: &[(EpisodeRow, Option<StoredLog>)],
) -> Result<(), StoreError> {
    for rows in rows.chunks(MAX_ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT INTO episodes (lease, number, state, digest, score, success, skill, floor, reference,
                                   planner_version, outcome, policy_version, reason, metrics, at) ",
        );
        statement.push_values(rows, |mut values, (row, _)| {
            values.push_bind(row.lease).push_bind(row.number).push_bind(row.state).push_bind(&row.digest);
            values.push_bind(row.score).push_bind(row.success).push_bind(row.skill).push_bind(row.floor);
            values.push_bind(row.reference).push_bind(row.planner_version).push_bind(&row.outcome);
            values.push_bind(row.policy_version).push_bind(&row.reason).push_bind(&row.metrics);
            values.push_bind(row.at);
        });
        let logged: Vec<_> = rows.iter().filter(|(_, log)| log.is_some()).collect();
        if !logged.is_empty() {
            statement.push("; INSERT INTO action_logs (lease, number, body) ");
            statement.push_values(logged, |mut values, (row, log)| {
                values
                    .push_bind(row.lease)
                    .push_bind(row.number)
                    .push_bind(log.as_ref().map(|log| &log.body));
            });
        }
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// A result that was reported before: enough to tell a repeated report from a contradicting one, and to answer it.
#[derive(Debug, Clone, PartialEq)]
pub struct ReportedResult {
    /// Number of the lease.
    pub lease: i64,
    /// Index of the episode in the lease.
    pub number: i64,
    /// Digest of the reported result.
    pub digest: Vec<u8>,
    /// Score that the world computed.
    pub score: Option<f64>,
    /// Skill, if the scenario defines one.
    pub skill: Option<f64>,
    /// True if the episode is a success.
    pub success: Option<bool>,
}

/// Reads which of these episodes were reported before.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn reported_among(
    conn: &mut SqliteConnection,
    keys: &[EpisodeKey],
) -> Result<Vec<ReportedResult>, StoreError> {
    let keys = to_json(&keys)?;
    Ok(sqlx::query_as!(
        ReportedResult,
        r#"SELECT e.lease AS "lease!", e.number AS "number!", e.digest AS "digest!", e.score AS "score?: f64",
                  e.skill AS "skill?: f64", e.success AS "success?: bool"
           FROM json_each(?) AS place CROSS JOIN episodes e
           ON e.lease = place.value ->> 0 AND e.number = place.value ->> 1"#,
        keys
    )
    .fetch_all(conn)
    .await?)
}

/// Selects [`EpisodeRow`]s: takes what follows `FROM episodes` and the arguments of the statement.
macro_rules! query_episodes {
    ($rest:literal, $($argument:expr),+ $(,)?) => {
        sqlx::query_as!(
            EpisodeRow,
            r#"SELECT lease, number, state AS "state: EpisodeState", digest, score, success AS "success: bool", skill, floor,
                      reference, planner_version, outcome, policy_version, reason, metrics, at
               FROM episodes "# + $rest,
            $($argument),+
        )
    };
}

/// Reads an episode.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get(
    conn: &mut SqliteConnection,
    lease: i64,
    number: i64,
) -> Result<Option<EpisodeRow>, StoreError> {
    Ok(query_episodes!("WHERE lease = ? AND number = ?", lease, number).fetch_optional(conn).await?)
}

/// Reads the reported episodes of leases, in order of lease and index.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_leases(conn: &mut SqliteConnection, leases: &[i64]) -> Result<Vec<EpisodeRow>, StoreError> {
    let leases = to_json(&leases)?;
    Ok(query_episodes!("WHERE lease IN (SELECT value FROM json_each(?)) ORDER BY lease, number", leases)
        .fetch_all(conn)
        .await?)
}

/// Reads the indices of a lease's reported episodes, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn reported(conn: &mut SqliteConnection, lease: i64) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT number FROM episodes WHERE lease = ? ORDER BY number", lease)
        .fetch_all(conn)
        .await?)
}

/// Reads the action log of an episode.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails, and [`StoreError::Corrupt`] if the log cannot be decoded.
pub async fn log(
    conn: &mut SqliteConnection,
    lease: i64,
    number: i64,
) -> Result<Option<ActionLog>, StoreError> {
    let body =
        sqlx::query_scalar!("SELECT body FROM action_logs WHERE lease = ? AND number = ?", lease, number)
            .fetch_optional(conn)
            .await?;
    body.map(|body| decode_log(&body)).transpose()
}

/// Reads action logs in one statement. A log that cannot be decoded is an error of its own entry.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn logs(
    conn: &mut SqliteConnection,
    keys: &[EpisodeKey],
) -> Result<HashMap<EpisodeKey, Result<ActionLog, StoreError>>, StoreError> {
    let keys = to_json(&keys)?;
    let rows = query!(
        r#"SELECT a.lease AS "lease!", a.number AS "number!", a.body AS "body!" FROM json_each(?) AS place
           CROSS JOIN action_logs a ON a.lease = place.value ->> 0 AND a.number = place.value ->> 1"#,
        keys
    )
    .fetch_all(conn)
    .await?;
    let logs = rows
        .into_iter()
        .map(|row| (EpisodeKey { lease: row.lease, number: row.number }, decode_log(&row.body)));
    Ok(logs.collect())
}

pub(crate) fn decode_log(body: &[u8]) -> Result<ActionLog, StoreError> {
    Ok(ActionLog::decode(&unpack("an action log", body)?)?)
}

/// Result of a finished episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FinishedEpisode {
    /// True if the episode is a success.
    pub success: bool,
    /// Skill, if the scenario defines one.
    pub skill: Option<f64>,
    /// Score that the world computed.
    pub score: f64,
    /// Reference score of the bracket.
    pub reference: f64,
    /// Version of the policy that ran the episode.
    pub policy_version: i64,
    /// Number of its environment steps.
    pub steps: i64,
}

/// Reads the results of finished episodes among a span, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn finished(
    conn: &mut SqliteConnection,
    span: EpisodeSpan,
) -> Result<Vec<FinishedEpisode>, StoreError> {
    let rows = query!(
        r#"SELECT success AS "success: bool", skill, score, reference, policy_version, outcome ->> '$.steps' AS "steps: i64"
           FROM episodes WHERE lease = ? AND number >= ? AND number < ? AND state = 'finished' ORDER BY number"#,
        span.lease,
        span.from,
        span.to
    )
    .fetch_all(conn)
    .await?;
    let finished = rows.into_iter().map(|r| FinishedEpisode {
        success: r.success == Some(true),
        skill: r.skill,
        score: r.score.unwrap_or(0.0),
        reference: r.reference.unwrap_or(0.0),
        policy_version: r.policy_version,
        steps: r.steps.unwrap_or(0),
    });
    Ok(finished.collect())
}

/// Reads the outcomes of finished episodes among a span, in order, as JSON.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn finished_outcomes(
    conn: &mut SqliteConnection,
    span: EpisodeSpan,
) -> Result<Vec<String>, StoreError> {
    let rows = sqlx::query_scalar!(
        "SELECT outcome FROM episodes
         WHERE lease = ? AND number >= ? AND number < ? AND state = 'finished' ORDER BY number",
        span.lease,
        span.from,
        span.to
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().flatten().collect())
}
