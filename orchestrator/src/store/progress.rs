//! Success over time, from groups that were evidence: groups that are stored whole, and spans of compacted ones. Tables `groups`
//! and `folded_progress`.

use std::collections::BTreeMap;

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// Consecutive contested groups of a task that were evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgressSpan {
    /// When the last group closed.
    pub at: Millis,
    /// Lowest level that occurred.
    pub low: Option<i64>,
    /// Highest level that occurred.
    pub high: Option<i64>,
    /// Number of its groups.
    pub n: i64,
    /// Sum of their success rates.
    pub sum: f64,
}

impl ProgressSpan {
    /// Adds a later span.
    pub fn join(&mut self, later: &Self) {
        let lowest = |a: Option<i64>, b: Option<i64>| a.into_iter().chain(b).min();
        *self = Self {
            at: self.at.max(later.at),
            low: lowest(self.low, later.low),
            high: self.high.max(later.high),
            n: self.n + later.n,
            sum: self.sum + later.sum,
        };
    }
}

/// A span with its task.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskSpan {
    /// Id of the task.
    pub task: String,
    /// The span of time.
    pub span: ProgressSpan,
}

/// Reads the evidence of each task of a run in order of time, in at most `parts` spans of about equal size.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn of_run(
    conn: &mut SqliteConnection,
    run: &str,
    parts: usize,
) -> Result<Vec<TaskSpan>, StoreError> {
    let mut spans = BTreeMap::<String, Vec<ProgressSpan>>::new();
    for TaskSpan { task, span } in
        compacted(conn, run).await?.into_iter().chain(whole(conn, run, parts).await?)
    {
        spans.entry(task).or_default().push(span);
    }
    let thinned = spans.into_iter().flat_map(|(task, spans)| {
        thin(spans, parts).into_iter().map(move |span| TaskSpan { task: task.clone(), span })
    });
    Ok(thinned.collect())
}

/// Joins neighbours until there are at most `limit` spans.
fn thin(spans: Vec<ProgressSpan>, limit: usize) -> Vec<ProgressSpan> {
    if spans.len() <= limit {
        return spans;
    }
    let all: i64 = spans.iter().map(|span| span.n).sum();
    let enough = all as f64 / limit as f64;
    let mut thinned = Vec::<ProgressSpan>::with_capacity(limit);
    for span in spans {
        match thinned.last_mut().filter(|last| (last.n as f64) < enough) {
            Some(last) => last.join(&span),
            None => thinned.push(span),
        }
    }
    thinned
}

/// A row of either query.
struct SpanRow {
    task: String,
    at: Millis,
    low: Option<i64>,
    high: Option<i64>,
    n: i64,
    sum: f64,
}

impl From<SpanRow> for TaskSpan {
    fn from(row: SpanRow) -> Self {
        let SpanRow { task, at, low, high, n, sum } = row;
        Self { task, span: ProgressSpan { at, low, high, n, sum } }
    }
}

/// Reads spans of groups that are stored whole.
async fn whole(conn: &mut SqliteConnection, run: &str, parts: usize) -> Result<Vec<TaskSpan>, StoreError> {
    let parts = parts as i64;
    let rows = sqlx::query_as!(
        SpanRow,
        r#"SELECT task AS "task!", max(closed_at) AS "at!: i64", min(level) AS "low: i64", max(level) AS "high: i64",
                  count(*) AS "n!: i64", sum(1.0 * successes / finished) AS "sum!: f64"
           FROM (
               SELECT g.task, g.level, g.closed_at, g.successes, g.finished,
                      ntile(?2) OVER (PARTITION BY g.task ORDER BY g.closed_at, g.lease, g.number) AS part
               FROM leases l JOIN groups g ON g.lease = l.id
               WHERE l.run = ?1 AND l.folded = 0 AND g.contested = 1 AND g.evidence = 1 AND g.finished > 0
                     AND g.state IN ('complete', 'partial')
                     AND (g.proposal IS NOT NULL OR g.layout IS NOT NULL)
           )
           GROUP BY task, part ORDER BY task, part"#,
        run,
        parts
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(TaskSpan::from).collect())
}

/// Reads spans of compacted groups.
async fn compacted(conn: &mut SqliteConnection, run: &str) -> Result<Vec<TaskSpan>, StoreError> {
    let rows = sqlx::query_as!(
        SpanRow,
        r#"SELECT task, at, low, high, n, success AS "sum: f64" FROM folded_progress
           WHERE run = ? ORDER BY task, nth"#,
        run
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(TaskSpan::from).collect())
}

/// A stored span grows until it holds this fraction of all groups. A long run has about a thousand spans.
const SPAN_FRACTION: i64 = 128;
/// A stored span grows at least to this number of groups.
const MIN_SPAN_GROUPS: i64 = 8;

/// Adds groups of a task that are compacted now.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn add_compacted(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    span: &ProgressSpan,
) -> Result<(), StoreError> {
    let last = query!(
        r#"SELECT nth, at, low, high, n, success AS "sum: f64",
                  (SELECT sum(n) FROM folded_progress WHERE run = ?1 AND task = ?2) AS "all!: i64"
           FROM folded_progress WHERE run = ?1 AND task = ?2 ORDER BY nth DESC LIMIT 1"#,
        run,
        task
    )
    .fetch_optional(&mut *conn)
    .await?;
    let (nth, span) = match last {
        None => (0, span.clone()),
        Some(last) if last.n >= MIN_SPAN_GROUPS.max(last.all / SPAN_FRACTION) => (last.nth + 1, span.clone()),
        Some(last) => {
            let mut joined =
                ProgressSpan { at: last.at, low: last.low, high: last.high, n: last.n, sum: last.sum };
            joined.join(span);
            (last.nth, joined)
        }
    };
    query!(
        "INSERT INTO folded_progress (run, task, nth, at, low, high, n, success) VALUES (?, ?, ?, ?, ?, ?, ?, ?)
         ON CONFLICT (run, task, nth) DO UPDATE SET at = excluded.at, low = excluded.low, high = excluded.high,
             n = excluded.n, success = excluded.success",
        run,
        task,
        nth,
        span.at,
        span.low,
        span.high,
        span.n,
        span.sum
    )
    .execute(conn)
    .await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_order_and_totals() {
        let span = |at: i64| ProgressSpan { at, low: Some(at), high: Some(at), n: 1 + at % 7, sum: 0.5 };
        for count in [0, 1, 100, 101, 1000] {
            let all: Vec<_> = (0..count).map(span).collect();
            let thinned = thin(all.clone(), 100);
            assert!(thinned.len() <= 100, "{}", thinned.len());
            assert_eq!(thinned.iter().map(|s| s.n).sum::<i64>(), all.iter().map(|s| s.n).sum::<i64>());
            assert!(thinned.is_sorted_by_key(|s| s.at));
            assert_eq!(thinned.last().map(|s| s.at), all.last().map(|s| s.at));
        }
    }
}
