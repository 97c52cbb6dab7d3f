//! Success over time, from the groups that were evidence.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// A stretch of a task's evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// The task.
    pub task: String,
    /// When its last group closed.
    pub at: Millis,
    /// The lowest level in it.
    pub low: Option<i64>,
    /// The highest.
    pub high: Option<i64>,
    /// Contested scenarios in it.
    pub n: i64,
    /// Mean of their success shares.
    pub success: f64,
}

/// Each task's contested evidence in order of time, in at most `stretches` parts of equal size.
///
/// # Errors
/// The database's.
pub async fn of_run(
    conn: &mut SqliteConnection,
    run: &str,
    stretches: i64,
) -> Result<Vec<Stretch>, StoreError> {
    let rows = query!(
        r#"SELECT task AS "task!", max(closed_at) AS "at!: i64", min(level) AS "low: i64", max(level) AS "high: i64",
                  count(*) AS "n!: i64", avg(1.0 * successes / finished) AS "success!: f64"
           FROM (
               SELECT g.task, g.level, g.closed_at, g.successes, g.finished,
                      ntile(?2) OVER (PARTITION BY g.task ORDER BY g.closed_at, g.lease, g.number) AS part
               FROM leases l JOIN groups g ON g.lease = l.id
               WHERE l.run = ?1 AND g.contested = 1 AND g.evidence = 1 AND g.finished > 0
                     AND g.state IN ('complete', 'partial')
                     AND (g.proposal IS NOT NULL OR g.layout IS NOT NULL)
           )
           GROUP BY task, part ORDER BY task, part"#,
        run,
        stretches
    )
    .fetch_all(conn)
    .await?;
    Ok(rows
        .into_iter()
        .map(|r| Stretch { task: r.task, at: r.at, low: r.low, high: r.high, n: r.n, success: r.success })
        .collect())
}
