//! The queue of episodes that wait for their critique, and the counters that a failure profile rests on. Tables
//! `critique_queue` and `critique_counters`.

use std::collections::{BTreeMap, BTreeSet};

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{MAX_ROWS, StoreError, from_json, to_json};

/// Row of the `critique_queue` table: episodes of one lease and task.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CritiqueJob {
    /// Number of the job. Numbers are never reused.
    pub id: i64,
    /// Id of the run.
    pub run: String,
    /// Task of the episodes.
    pub task: String,
    /// Number of the lease.
    pub lease: i64,
    /// Episodes in each group of the lease.
    pub group_size: i64,
    /// Indices of the episodes in the lease, as JSON.
    pub numbers: String,
    /// Number of its episodes.
    pub episodes: i64,
}

impl CritiqueJob {
    /// Indices of the episodes in the lease.
    ///
    /// # Errors
    /// Returns [`StoreError::Corrupt`] if the stored list is not valid JSON.
    pub fn numbers(&self) -> Result<Vec<i64>, StoreError> {
        from_json("a list of episodes to criticise", &self.numbers)
    }
}

/// A sum over all criticised episodes, beside one that decays.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DecayingSum<T> {
    /// Sum over all episodes.
    pub overall: T,
    /// Sum that halves with every half-life, counted in criticised episodes.
    pub recent: f64,
}

/// Row of the `critique_counters` table, without its run and task.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CritiqueCounters {
    /// Number of criticised episodes.
    pub criticised: i64,
    /// Episodes that sampling left out.
    pub skipped: i64,
    /// Episodes that could not be criticised.
    pub failed: i64,
    /// Sum of the judge's values.
    pub judgement: DecayingSum<f64>,
    /// Actions by the judge's verdict: needed, harmless, wasteful, harmful.
    pub verdicts: [DecayingSum<i64>; 4],
}

/// A critique job to be stored.
#[derive(Debug, Clone, Copy)]
pub struct NewCritiqueJob<'a> {
    /// Task of the episodes.
    pub task: &'a str,
    /// Number of the lease.
    pub lease: i64,
    /// Indices of the episodes in the lease.
    pub numbers: &'a [i64],
}

/// Adds jobs to the end of the queue.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn enqueue(
    conn: &mut SqliteConnection,
    run: &str,
    jobs: &[NewCritiqueJob<'_>],
) -> Result<(), StoreError> {
    let rows = jobs.iter().map(|job| Ok((job, to_json(&job.numbers)?)));
    let rows = rows.collect::<Result<Vec<_>, StoreError>>()?;
    for rows in rows.chunks(MAX_ROWS) {
        let mut statement =
            QueryBuilder::new("INSERT INTO critique_queue (run, task, lease, numbers, episodes) ");
        statement.push_values(rows, |mut values, (job, numbers)| {
            values.push_bind(run).push_bind(job.task).push_bind(job.lease).push_bind(numbers);
            values.push_bind(job.numbers.len() as i64);
        });
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Reads the oldest jobs of the queue.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn oldest(conn: &mut SqliteConnection, limit: i64) -> Result<Vec<CritiqueJob>, StoreError> {
    Ok(sqlx::query_as!(
        CritiqueJob,
        "SELECT q.id, q.run, q.task, q.lease, l.group_size, q.numbers, q.episodes
         FROM critique_queue q JOIN leases l ON l.id = q.lease JOIN runs r ON r.id = q.run
         WHERE r.deleted_at IS NULL ORDER BY q.id LIMIT ?",
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Removes jobs from the queue. Returns those that were still in it.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn dequeue(conn: &mut SqliteConnection, ids: &[i64]) -> Result<BTreeSet<i64>, StoreError> {
    let ids = to_json(&ids)?;
    let removed = sqlx::query_scalar!(
        "DELETE FROM critique_queue WHERE id IN (SELECT value FROM json_each(?)) RETURNING id",
        ids
    )
    .fetch_all(conn)
    .await?;
    Ok(removed.into_iter().collect())
}

/// Counts the waiting episodes of each run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn waiting_by_run(conn: &mut SqliteConnection) -> Result<BTreeMap<String, i64>, StoreError> {
    let rows = query!(
        r#"SELECT run AS "run!", sum(episodes) AS "episodes!: i64" FROM critique_queue
           WHERE run NOT IN (SELECT id FROM runs WHERE deleted_at IS NOT NULL) GROUP BY run ORDER BY run"#
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (row.run, row.episodes)).collect())
}

/// Counts the waiting episodes of each task of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn waiting_by_task(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<BTreeMap<String, i64>, StoreError> {
    let rows = query!(
        r#"SELECT task AS "task!", sum(episodes) AS "episodes!: i64" FROM critique_queue WHERE run = ?
           GROUP BY task ORDER BY task"#,
        run
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (row.task, row.episodes)).collect())
}

/// Reads the counters of a run's task; zeros if nothing was criticised yet.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn counters(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
) -> Result<CritiqueCounters, StoreError> {
    let row = query!(
        "SELECT criticised, skipped, failed, judgement, judgement_recent, needed, needed_recent, harmless, harmless_recent,
                wasteful, wasteful_recent, harmful, harmful_recent
         FROM critique_counters WHERE run = ? AND task = ?",
        run,
        task
    )
    .fetch_optional(conn)
    .await?;
    Ok(row.map_or_else(CritiqueCounters::default, |r| CritiqueCounters {
        criticised: r.criticised,
        skipped: r.skipped,
        failed: r.failed,
        judgement: DecayingSum { overall: r.judgement, recent: r.judgement_recent },
        verdicts: [
            DecayingSum { overall: r.needed, recent: r.needed_recent },
            DecayingSum { overall: r.harmless, recent: r.harmless_recent },
            DecayingSum { overall: r.wasteful, recent: r.wasteful_recent },
            DecayingSum { overall: r.harmful, recent: r.harmful_recent },
        ],
    }))
}

/// Replaces the counters of a run's task.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn put_counters(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    counters: &CritiqueCounters,
) -> Result<(), StoreError> {
    let [needed, harmless, wasteful, harmful] = counters.verdicts;
    query!(
        "INSERT OR REPLACE INTO critique_counters (run, task, criticised, skipped, failed, judgement, judgement_recent, needed,
             needed_recent, harmless, harmless_recent, wasteful, wasteful_recent, harmful, harmful_recent)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        run,
        task,
        counters.criticised,
        counters.skipped,
        counters.failed,
        counters.judgement.overall,
        counters.judgement.recent,
        needed.overall,
        needed.recent,
        harmless.overall,
        harmless.recent,
        wasteful.overall,
        wasteful.recent,
        harmful.overall,
        harmful.recent
    )
    .execute(conn)
    .await?;
    Ok(())
}
