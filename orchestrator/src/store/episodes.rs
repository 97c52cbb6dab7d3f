//! Reported episodes and their action logs.

use std::collections::HashMap;

use env_core::ActionLog;
use sqlx::{QueryBuilder, SqliteConnection, query};

use super::pack::{pack, unpack};
use super::{ROWS, StoreError, digest, to_json};
use crate::clock::Millis;

/// An episode as stored.
#[derive(Debug, Clone)]
pub struct EpisodeRow {
    /// Its lease.
    pub lease: i64,
    /// Its index in the lease.
    pub number: i64,
    /// `finished`, `failed` or `late`.
    pub state: String,
    /// Of what was reported.
    pub digest: Vec<u8>,
    /// The world's score, from replay.
    pub score: Option<f64>,
    /// Whether it counts as a success.
    pub success: Option<i64>,
    /// Skill, where the scenario defines one.
    pub skill: Option<f64>,
    /// The floor it was judged by.
    pub floor: Option<f64>,
    /// The reference score it was judged by.
    pub reference: Option<f64>,
    /// The planner of that bracket.
    pub planner: Option<i64>,
    /// JSON: how it was flown.
    pub flown: Option<String>,
    /// The policy that flew it.
    pub policy_version: i64,
    /// Why it failed.
    pub reason: Option<String>,
    /// JSON: what the trainer logged.
    pub metrics: Option<String>,
    /// When it was reported.
    pub at: Millis,
}

/// An action log as it is stored.
#[derive(Debug, Clone)]
pub struct StoredLog {
    /// Of the log, to tell a repeat from a contradiction.
    pub digest: [u8; 16],
    body: Vec<u8>,
}

impl StoredLog {
    /// Encodes and packs it: where there is time for that.
    #[must_use]
    pub fn of(log: &ActionLog) -> Self {
        let encoded = log.encode();
        Self { digest: digest(&encoded), body: pack(encoded) }
    }
}

/// Stores episodes, those that were flown with their action logs.
///
/// # Errors
/// The database's.
pub async fn insert(
    conn: &mut SqliteConnection,
    rows: &[(EpisodeRow, Option<StoredLog>)],
) -> Result<(), StoreError> {
    for rows in rows.chunks(ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT INTO episodes (lease, number, state, digest, score, success, skill, floor, reference, planner,
                                   flown, policy_version, reason, metrics, at) ",
        );
        statement.push_values(rows, |mut values, (row, _)| {
            values.push_bind(row.lease).push_bind(row.number).push_bind(&row.state).push_bind(&row.digest);
            values.push_bind(row.score).push_bind(row.success).push_bind(row.skill).push_bind(row.floor);
            values.push_bind(row.reference).push_bind(row.planner).push_bind(&row.flown);
            values.push_bind(row.policy_version).push_bind(&row.reason).push_bind(&row.metrics);
            values.push_bind(row.at);
        });
        let flown: Vec<_> = rows.iter().filter(|(_, log)| log.is_some()).collect();
        if !flown.is_empty() {
            statement.push("; INSERT INTO action_logs (lease, number, body) ");
            statement.push_values(flown, |mut values, (row, log)| {
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

/// What tells a report of an episode from the one before, and what that was answered with.
#[derive(Debug, Clone, PartialEq)]
pub struct Before {
    /// Its lease.
    pub lease: i64,
    /// Its index in the lease.
    pub number: i64,
    /// Of what was reported.
    pub digest: Vec<u8>,
    /// The world's score.
    pub score: Option<f64>,
    /// Skill.
    pub skill: Option<f64>,
    /// Whether it counts as a success.
    pub success: Option<i64>,
}

/// Which of these episodes, by lease and index, were reported.
///
/// # Errors
/// The database's.
pub async fn before(conn: &mut SqliteConnection, places: &[(i64, i64)]) -> Result<Vec<Before>, StoreError> {
    let places = to_json(&places)?;
    Ok(sqlx::query_as!(
        Before,
        r#"SELECT e.lease AS "lease!", e.number AS "number!", e.digest AS "digest!", e.score AS "score?: f64",
                  e.skill AS "skill?: f64", e.success AS "success?: i64"
           FROM json_each(?) AS place CROSS JOIN episodes e
           ON e.lease = place.value ->> 0 AND e.number = place.value ->> 1"#,
        places
    )
    .fetch_all(conn)
    .await?)
}

/// One episode.
///
/// # Errors
/// The database's.
pub async fn get(
    conn: &mut SqliteConnection,
    lease: i64,
    number: i64,
) -> Result<Option<EpisodeRow>, StoreError> {
    Ok(sqlx::query_as!(
        EpisodeRow,
        "SELECT lease, number, state, digest, score, success, skill, floor, reference, planner, flown, policy_version,
                reason, metrics, at
         FROM episodes WHERE lease = ? AND number = ?",
        lease,
        number
    )
    .fetch_optional(conn)
    .await?)
}

/// The reported episodes of leases, in order.
///
/// # Errors
/// The database's.
pub async fn of_leases(conn: &mut SqliteConnection, leases: &[i64]) -> Result<Vec<EpisodeRow>, StoreError> {
    let leases = to_json(&leases)?;
    Ok(sqlx::query_as!(
        EpisodeRow,
        "SELECT lease, number, state, digest, score, success, skill, floor, reference, planner, flown, policy_version,
                reason, metrics, at
         FROM episodes WHERE lease IN (SELECT value FROM json_each(?)) ORDER BY lease, number",
        leases
    )
    .fetch_all(conn)
    .await?)
}

/// Indices of a lease's episodes that were reported.
///
/// # Errors
/// The database's.
pub async fn reported(conn: &mut SqliteConnection, lease: i64) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT number FROM episodes WHERE lease = ? ORDER BY number", lease)
        .fetch_all(conn)
        .await?)
}

/// One action log.
///
/// # Errors
/// The database's.
pub async fn log(
    conn: &mut SqliteConnection,
    lease: i64,
    number: i64,
) -> Result<Option<ActionLog>, StoreError> {
    let body =
        sqlx::query_scalar!("SELECT body FROM action_logs WHERE lease = ? AND number = ?", lease, number)
            .fetch_optional(conn)
            .await?;
    body.map(|body| read(&body)).transpose()
}

fn read(body: &[u8]) -> Result<ActionLog, StoreError> {
    Ok(ActionLog::decode(&unpack("an action log", body)?)?)
}

/// Action logs by lease and index, in one statement however many they are.
///
/// # Errors
/// The database's.
pub async fn logs(
    conn: &mut SqliteConnection,
    places: &[(i64, i64)],
) -> Result<HashMap<(i64, i64), Result<ActionLog, StoreError>>, StoreError> {
    let places = to_json(&places)?;
    let rows = query!(
        r#"SELECT a.lease AS "lease!", a.number AS "number!", a.body AS "body!" FROM json_each(?) AS place
           CROSS JOIN action_logs a ON a.lease = place.value ->> 0 AND a.number = place.value ->> 1"#,
        places
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| ((row.lease, row.number), read(&row.body))).collect())
}

/// A reported episode in a list.
#[derive(Debug, Clone)]
pub struct Listed {
    /// The token of its lease.
    pub token: String,
    /// What is known of it by its group.
    pub of: OfGroup,
    /// The episode.
    pub row: EpisodeRow,
}

/// What an episode is of.
#[derive(Debug, Clone, PartialEq)]
pub struct OfGroup {
    /// The task.
    pub task: String,
    /// The level.
    pub level: Option<i64>,
    /// The proposal's role, or `designed`, or `suite`.
    pub role: String,
    /// Its layout, where its group was designed.
    pub layout: Option<i64>,
}

/// Reported episodes of a run after (lease, index), in that order.
///
/// # Errors
/// The database's.
pub async fn page(
    conn: &mut SqliteConnection,
    run: &str,
    after: (i64, i64),
    limit: i64,
) -> Result<Vec<Listed>, StoreError> {
    let rows = query!(
        r#"SELECT l.token, g.task, g.level, g.role, g.layout, e.lease AS "lease!", e.number AS "number!", e.state, e.digest, e.score, e.success, e.skill,
                  e.floor, e.reference, e.planner, e.flown, e.policy_version, e.reason, e.metrics, e.at
           FROM leases l JOIN episodes e ON e.lease = l.id
           JOIN groups g ON g.lease = e.lease AND g.number = e.number / l.group_size
           WHERE l.run = ?1 AND l.id >= ?2 AND (e.lease, e.number) > (?2, ?3)
           ORDER BY l.id, e.number LIMIT ?4"#,
        run,
        after.0,
        after.1,
        limit
    )
    .fetch_all(conn)
    .await?;
    Ok(rows
        .into_iter()
        .map(|r| {
            let row = EpisodeRow {
                lease: r.lease,
                number: r.number,
                state: r.state,
                digest: r.digest,
                score: r.score,
                success: r.success,
                skill: r.skill,
                floor: r.floor,
                reference: r.reference,
                planner: r.planner,
                flown: r.flown,
                policy_version: r.policy_version,
                reason: r.reason,
                metrics: r.metrics,
                at: r.at,
            };
            Listed {
                token: r.token,
                of: OfGroup { task: r.task, level: r.level, role: r.role, layout: r.layout },
                row,
            }
        })
        .collect())
}

/// How a finished episode fared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fared {
    /// Whether it succeeded.
    pub success: bool,
    /// Its skill, where the scenario defines one.
    pub skill: Option<f64>,
    /// Its score.
    pub score: f64,
    /// What the reference earned.
    pub reference: f64,
    /// The policy that flew it.
    pub policy_version: i64,
}

/// How the finished episodes of a range flew, in order, as JSON.
///
/// # Errors
/// The database's.
pub async fn finished_of(
    conn: &mut SqliteConnection,
    lease: i64,
    (from, to): (i64, i64),
) -> Result<Vec<String>, StoreError> {
    let rows = sqlx::query_scalar!(
        "SELECT flown FROM episodes
         WHERE lease = ? AND number >= ? AND number < ? AND state = 'finished' ORDER BY number",
        lease,
        from,
        to
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().flatten().collect())
}

/// How the finished episodes of one group fared, in order.
///
/// # Errors
/// The database's.
pub async fn of_group(
    conn: &mut SqliteConnection,
    lease: i64,
    from: i64,
    to: i64,
) -> Result<Vec<Fared>, StoreError> {
    let rows = query!(
        "SELECT success, skill, score, reference, policy_version FROM episodes
         WHERE lease = ? AND number >= ? AND number < ? AND state = 'finished' ORDER BY number",
        lease,
        from,
        to
    )
    .fetch_all(conn)
    .await?;
    let fared = rows.into_iter().map(|r| Fared {
        success: r.success == Some(1),
        skill: r.skill,
        score: r.score.unwrap_or(0.0),
        reference: r.reference.unwrap_or(0.0),
        policy_version: r.policy_version,
    });
    Ok(fared.collect())
}
