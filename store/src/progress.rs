//! Success over time, from slots: groups that are stored whole, and spans of compacted ones. Missing episodes count as failures. Tables `groups`
//! and `compacted_progress`.

use std::collections::BTreeMap;

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::Millis;

/// Consecutive slots of a task.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgressSpan {
    /// When the last group closed.
    pub at: Millis,
    /// Lowest level that occurred.
    pub lowest_level: Option<i64>,
    /// Highest level that occurred.
    pub highest_level: Option<i64>,
    /// Number of its groups.
    pub groups: i64,
    /// Sum of their success rates.
    pub success_rate_sum: f64,
}

impl ProgressSpan {
    /// Adds a later span.
    pub fn join(&mut self, later: &Self) {
        let lowest = |a: Option<i64>, b: Option<i64>| a.into_iter().chain(b).min();
        *self = Self {
            at: self.at.max(later.at),
            lowest_level: lowest(self.lowest_level, later.lowest_level),
            highest_level: self.highest_level.max(later.highest_level),
            groups: self.groups + later.groups,
            success_rate_sum: self.success_rate_sum + later.success_rate_sum,
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
    let all: i64 = spans.iter().map(|span| span.groups).sum();
    let enough = all as f64 / limit as f64;
    let mut thinned = Vec::<ProgressSpan>::with_capacity(limit);
    for span in spans {
        match thinned.last_mut().filter(|last| (last.groups as f64) < enough) {
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
    lowest_level: Option<i64>,
    highest_level: Option<i64>,
    groups: i64,
    success_rate_sum: f64,
}

impl From<SpanRow> for TaskSpan {
    fn from(row: SpanRow) -> Self {
        let SpanRow { task, at, lowest_level, highest_level, groups, success_rate_sum } = row;
        Self { task, span: ProgressSpan { at, lowest_level, highest_level, groups, success_rate_sum } }
    }
}

/// Reads spans of groups that are stored whole.
async fn whole(conn: &mut SqliteConnection, run: &str, parts: usize) -> Result<Vec<TaskSpan>, StoreError> {
    let parts = parts as i64;
    let rows = sqlx::query_as!(
        SpanRow,
        r#"SELECT task AS "task!", max(closed_at) AS "at!: i64", min(level) AS "lowest_level: i64",
                  max(level) AS "highest_level: i64", count(*) AS "groups!: i64",
                  sum(max(0.0, counted_successes - abandoned) / group_size) AS "success_rate_sum!: f64"
           FROM (
               SELECT g.task, g.level, g.closed_at, g.counted_successes, g.abandoned, l.group_size,
                      ntile(?2) OVER (PARTITION BY g.task ORDER BY g.closed_at, g.lease, g.number) AS part
               FROM leases l JOIN groups g ON g.lease = l.id
               WHERE l.run = ?1 AND l.is_compacted = 0 AND g.is_slot = 1 AND g.state <> 'open'
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
        "SELECT task, at, lowest_level, highest_level, groups, success_rate_sum FROM compacted_progress
         WHERE run = ? ORDER BY task, seq",
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
        r#"SELECT seq, at, lowest_level, highest_level, groups, success_rate_sum,
                  (SELECT sum(groups) FROM compacted_progress WHERE run = ?1 AND task = ?2) AS "all_groups!: i64"
           FROM compacted_progress WHERE run = ?1 AND task = ?2 ORDER BY seq DESC LIMIT 1"#,
        run,
        task
    )
    .fetch_optional(&mut *conn)
    .await?;
    let (seq, span) = match last {
        None => (0, span.clone()),
        Some(last) if last.groups >= MIN_SPAN_GROUPS.max(last.all_groups / SPAN_FRACTION) => {
            (last.seq + 1, span.clone())
        }
        Some(last) => {
            let mut joined = ProgressSpan {
                at: last.at,
                lowest_level: last.lowest_level,
                highest_level: last.highest_level,
                groups: last.groups,
                success_rate_sum: last.success_rate_sum,
            };
            joined.join(span);
            (last.seq, joined)
        }
    };
    query!(
        "INSERT INTO compacted_progress (run, task, seq, at, lowest_level, highest_level, groups, success_rate_sum)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?)
         ON CONFLICT (run, task, seq) DO UPDATE SET at = excluded.at, lowest_level = excluded.lowest_level,
             highest_level = excluded.highest_level, groups = excluded.groups,
             success_rate_sum = excluded.success_rate_sum",
        run,
        task,
        seq,
        span.at,
        span.lowest_level,
        span.highest_level,
        span.groups,
        span.success_rate_sum
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
        let span = |at: i64| ProgressSpan {
            at,
            lowest_level: Some(at),
            highest_level: Some(at),
            groups: 1 + at % 7,
            success_rate_sum: 0.5,
        };
        for count in [0, 1, 100, 101, 1000] {
            let all: Vec<_> = (0..count).map(span).collect();
            let thinned = thin(all.clone(), 100);
            assert!(thinned.len() <= 100, "{}", thinned.len());
            assert_eq!(
                thinned.iter().map(|s| s.groups).sum::<i64>(),
                all.iter().map(|s| s.groups).sum::<i64>()
            );
            assert!(thinned.is_sorted_by_key(|s| s.at));
            assert_eq!(thinned.last().map(|s| s.at), all.last().map(|s| s.at));
        }
    }
}
