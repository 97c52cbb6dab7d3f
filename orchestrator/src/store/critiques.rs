//! Episodes that wait for their critique, and what a failure profile rests on.

use std::collections::BTreeSet;

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{ROWS, StoreError, from_json, to_json};

/// Episodes of one lease and task that wait for their critique.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// Its number, never given twice.
    pub id: i64,
    /// The run.
    pub run: String,
    /// The task.
    pub task: String,
    /// The lease.
    pub lease: i64,
    /// Episodes of a group.
    pub group_size: i64,
    /// JSON: the episodes' indices in the lease.
    pub numbers: String,
    /// How many they are.
    pub episodes: i64,
}

impl Job {
    /// The episodes' indices in the lease.
    ///
    /// # Errors
    /// A list that was changed by hand.
    pub fn numbers(&self) -> Result<Vec<i64>, StoreError> {
        from_json("a list of episodes to criticise", &self.numbers)
    }
}

/// A sum over all criticised episodes, and the same halving every half-life.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Fading<T> {
    /// Over all.
    pub all: T,
    /// Halving.
    pub now: f64,
}

/// What the profile of a run's task rests on.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CritiqueSums {
    /// Episodes criticised.
    pub criticised: i64,
    /// Episodes sampled out.
    pub skipped: i64,
    /// Episodes that could not be criticised.
    pub failed: i64,
    /// The judge's values.
    pub judged: Fading<f64>,
    /// Actions by verdict: needed, harmless, wasteful, harmful.
    pub verdicts: [Fading<i64>; 4],
}

/// Episodes of one lease and task that are to wait: task, lease, their indices in the lease.
pub type Waits<'a> = (&'a str, i64, &'a [i64]);

/// Lets episodes of a run wait.
///
/// # Errors
/// The database's.
pub async fn enqueue(conn: &mut SqliteConnection, run: &str, jobs: &[Waits<'_>]) -> Result<(), StoreError> {
    let jobs =
        jobs.iter().map(|(task, lease, numbers)| Ok((task, lease, to_json(numbers)?, numbers.len() as i64)));
    let jobs = jobs.collect::<Result<Vec<_>, StoreError>>()?;
    for rows in jobs.chunks(ROWS) {
        let mut statement =
            QueryBuilder::new("INSERT INTO critique_queue (run, task, lease, numbers, episodes) ");
        statement.push_values(rows, |mut values, (task, lease, numbers, episodes)| {
            values.push_bind(run).push_bind(*task).push_bind(*lease).push_bind(numbers).push_bind(episodes);
        });
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Those that have waited longest.
///
/// # Errors
/// The database's.
pub async fn jobs(conn: &mut SqliteConnection, limit: i64) -> Result<Vec<Job>, StoreError> {
    Ok(sqlx::query_as!(
        Job,
        "SELECT q.id, q.run, q.task, q.lease, l.group_size, q.numbers, q.episodes
         FROM critique_queue q JOIN leases l ON l.id = q.lease ORDER BY q.id LIMIT ?",
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Takes jobs off the queue; those that were on it.
///
/// # Errors
/// The database's.
pub async fn take(conn: &mut SqliteConnection, ids: &[i64]) -> Result<BTreeSet<i64>, StoreError> {
    let ids = to_json(&ids)?;
    let taken = sqlx::query_scalar!(
        "DELETE FROM critique_queue WHERE id IN (SELECT value FROM json_each(?)) RETURNING id",
        ids
    )
    .fetch_all(conn)
    .await?;
    Ok(taken.into_iter().collect())
}

/// How many episodes wait, by run.
///
/// # Errors
/// The database's.
pub async fn waiting(conn: &mut SqliteConnection) -> Result<Vec<(String, i64)>, StoreError> {
    let rows = query!(
        r#"SELECT run AS "run!", sum(episodes) AS "episodes!: i64" FROM critique_queue GROUP BY run ORDER BY run"#
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|r| (r.run, r.episodes)).collect())
}

/// How many episodes of a run wait, by task.
///
/// # Errors
/// The database's.
pub async fn waiting_of(conn: &mut SqliteConnection, run: &str) -> Result<Vec<(String, i64)>, StoreError> {
    let rows = query!(
        r#"SELECT task AS "task!", sum(episodes) AS "episodes!: i64" FROM critique_queue WHERE run = ?
           GROUP BY task ORDER BY task"#,
        run
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|r| (r.task, r.episodes)).collect())
}

/// What the profile of a run's task rests on; zeros before the first.
///
/// # Errors
/// The database's.
pub async fn sums(conn: &mut SqliteConnection, run: &str, task: &str) -> Result<CritiqueSums, StoreError> {
    let row = query!(
        "SELECT criticised, skipped, failed, judged, judged_now, needed, needed_now, harmless, harmless_now, wasteful,
                wasteful_now, harmful, harmful_now
         FROM critique_sums WHERE run = ? AND task = ?",
        run,
        task
    )
    .fetch_optional(conn)
    .await?;
    Ok(row.map_or_else(CritiqueSums::default, |r| CritiqueSums {
        criticised: r.criticised,
        skipped: r.skipped,
        failed: r.failed,
        judged: Fading { all: r.judged, now: r.judged_now },
        verdicts: [
            Fading { all: r.needed, now: r.needed_now },
            Fading { all: r.harmless, now: r.harmless_now },
            Fading { all: r.wasteful, now: r.wasteful_now },
            Fading { all: r.harmful, now: r.harmful_now },
        ],
    }))
}

/// Writes what the profile of a run's task rests on.
///
/// # Errors
/// The database's.
pub async fn put_sums(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    sums: &CritiqueSums,
) -> Result<(), StoreError> {
    let [needed, harmless, wasteful, harmful] = sums.verdicts;
    query!(
        "INSERT OR REPLACE INTO critique_sums (run, task, criticised, skipped, failed, judged, judged_now, needed,
             needed_now, harmless, harmless_now, wasteful, wasteful_now, harmful, harmful_now)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        run,
        task,
        sums.criticised,
        sums.skipped,
        sums.failed,
        sums.judged.all,
        sums.judged.now,
        needed.all,
        needed.now,
        harmless.all,
        harmless.now,
        wasteful.all,
        wasteful.now,
        harmful.all,
        harmful.now
    )
    .execute(conn)
    .await?;
    Ok(())
}
