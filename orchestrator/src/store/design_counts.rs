//! Counts of what was designed: by state, by what the gate said, and how much of training it was.

use sqlx::{SqliteConnection, query};

use super::StoreError;

/// Adds to what the gate said.
///
/// # Errors
/// The database's.
pub async fn add_verdict(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    verdict: &str,
    count: i64,
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO gate_counts (run, task, verdict, count) VALUES (?, ?, ?, ?)
         ON CONFLICT (run, task, verdict) DO UPDATE SET count = count + excluded.count",
        run,
        task,
        verdict,
        count
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// What the gate said of a run's designs: (task, verdict, count).
///
/// # Errors
/// The database's.
pub async fn verdicts(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<Vec<(String, String, i64)>, StoreError> {
    let rows =
        query!("SELECT task, verdict, count FROM gate_counts WHERE run = ? ORDER BY task, verdict", run)
            .fetch_all(conn)
            .await?;
    Ok(rows.into_iter().map(|r| (r.task, r.verdict, r.count)).collect())
}

/// How many layouts a run has: (task, state, why it retired, count).
///
/// # Errors
/// The database's.
pub async fn states(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<Vec<(String, String, Option<String>, i64)>, StoreError> {
    let rows = query!(
        r#"SELECT task AS "task!", state AS "state!", why AS "why: String", count(*) AS "n!: i64" FROM layouts
           WHERE run = ? AND state != 'refused' GROUP BY task, state, why ORDER BY task, state, why"#,
        run
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|r| (r.task, r.state, r.why, r.n)).collect())
}

/// How many layouts of a run are active, by task and level.
///
/// # Errors
/// The database's.
pub async fn active(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<Vec<(String, Option<i64>, i64)>, StoreError> {
    let rows = query!(
        r#"SELECT task AS "task!", level AS "level: i64", count(*) AS "n!: i64" FROM layouts
           WHERE run = ? AND state = 'active' GROUP BY task, level ORDER BY task, level"#,
        run
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|r| (r.task, r.level, r.n)).collect())
}

/// Groups of a run that were leased for training, and how many of them were designed.
///
/// # Errors
/// The database's.
pub async fn groups(conn: &mut SqliteConnection, run: &str) -> Result<(i64, i64), StoreError> {
    let row = query!("SELECT train_groups, designed_groups FROM runs WHERE id = ?", run)
        .fetch_optional(conn)
        .await?;
    Ok(row.map_or((0, 0), |r| (r.train_groups, r.designed_groups)))
}

/// Counts groups that were leased for training.
///
/// # Errors
/// The database's.
pub async fn add_groups(
    conn: &mut SqliteConnection,
    run: &str,
    train: i64,
    designed: i64,
) -> Result<(), StoreError> {
    query!(
        "UPDATE runs SET train_groups = train_groups + ?, designed_groups = designed_groups + ? WHERE id = ?",
        train,
        designed,
        run
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// A task that a run has been criticised on.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Criticised {
    /// The run.
    pub run: String,
    /// The task.
    pub task: String,
    /// Episodes criticised.
    pub criticised: i64,
}

/// The tasks of active runs that want designs, with at least so many criticised episodes.
///
/// # Errors
/// The database's.
pub async fn criticised(conn: &mut SqliteConnection, least: i64) -> Result<Vec<Criticised>, StoreError> {
    Ok(sqlx::query_as!(
        Criticised,
        "SELECT c.run, c.task, c.criticised FROM critique_sums c JOIN runs r ON r.id = c.run
         WHERE r.status = 'active' AND c.criticised >= ? AND json_extract(r.settings, '$.design.share') > 0
               AND json_extract(r.settings, '$.design.designer') <> 'off' ORDER BY c.run, c.task",
        least
    )
    .fetch_all(conn)
    .await?)
}
