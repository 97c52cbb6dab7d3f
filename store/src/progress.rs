//! Success over time, from the slots in the history of a run. Missing episodes count as failures. Table `task_history`.

use std::collections::BTreeMap;

use sqlx::SqliteConnection;

use super::StoreError;
use crate::Millis;

/// Consecutive slots of a task.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgressSpan {
    /// End of the span, milliseconds since 1970-01-01 UTC.
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
    fn join(&mut self, later: &Self) {
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

/// Reads the evidence of each task of a run in order of time, in at most `parts` spans of about equal size. A span is at least a
/// minute long.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn of_run(
    conn: &mut SqliteConnection,
    run: &str,
    parts: usize,
) -> Result<Vec<TaskSpan>, StoreError> {
    let mut spans = BTreeMap::<String, Vec<ProgressSpan>>::new();
    for TaskSpan { task, span } in buckets(conn, run).await? {
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

/// A row of the query.
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

/// Reads the buckets of a run's history that have slots: of a minute if they are all kept, else of an hour.
async fn buckets(conn: &mut SqliteConnection, run: &str) -> Result<Vec<TaskSpan>, StoreError> {
    let rows = sqlx::query_as!(
        SpanRow,
        r#"WITH all_slots (width, slots) AS MATERIALIZED (
               SELECT width, sum(contested_groups) FROM task_history WHERE run = ?1 GROUP BY width)
           SELECT task, start + width AS "at!: i64", lowest_level, highest_level, contested_groups AS groups, success_rate_sum
           FROM task_history
           WHERE run = ?1 AND contested_groups > 0
                 AND width = (SELECT min(width) FROM all_slots WHERE slots = (SELECT max(slots) FROM all_slots))
           ORDER BY task, start"#,
        run
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(TaskSpan::from).collect())
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
