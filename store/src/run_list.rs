//! List of runs: a page of those that match a filter, in any order, and their number by group. Tables `runs` and `run_totals`.

use std::cmp::Ordering;

use sqlx::sqlite::SqliteRow;
use sqlx::{FromRow, QueryBuilder, Row, Sqlite, SqliteConnection};

use super::{StoreError, text_enum};
use crate::Millis;
use crate::run_filter::{RunFilter, push_filter};
use crate::runs::{self, RunRow};

/// Largest number of groups.
const MAX_GROUPS: i64 = 1000;

text_enum! {
    /// Value that runs can be sorted by. Runs without the value come last.
    pub enum RunSortKey: "a key of runs" {
        /// Time of the creation.
        Created = "created",
        /// Name of the run; ASCII letters of either case are equal.
        Name = "name",
        /// Number of its episodes.
        Episodes = "episodes",
        /// Time of its latest results.
        LastResults = "last_results",
        /// Mean skill of its latest episodes.
        Skill = "skill",
    }
}

text_enum! {
    /// Property that runs are grouped by.
    pub enum RunGrouping: "a grouping of runs" {
        /// Strategy of the run.
        Strategy = "strategy",
        /// All tasks of the run.
        Tasks = "tasks",
        /// A tag: a run is in the group of each of its tags.
        Tag = "tag",
        /// Activity of the run.
        Activity = "activity",
    }
}

/// Order of a list. Runs with equal values are ordered by their ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunOrder {
    /// Value to sort by.
    pub key: RunSortKey,
    /// True if the highest value comes first.
    pub is_descending: bool,
}

/// Value of a run by which a list is sorted.
#[derive(Debug, Clone, PartialEq)]
pub enum RunSortValue {
    /// Time, or a number.
    Integer(i64),
    /// Skill of the run.
    Real(f64),
    /// Name of the run.
    Text(String),
    /// No value; such runs come last.
    Missing,
}

impl RunOrder {
    /// Compares two positions as the statements of this file do, so that lists of several databases can be merged.
    #[must_use]
    pub fn compare(self, a: &RunPosition, b: &RunPosition) -> Ordering {
        let direct = |order: Ordering| if self.is_descending { order.reverse() } else { order };
        let values = match (&a.value, &b.value) {
            (RunSortValue::Missing, RunSortValue::Missing) => Ordering::Equal,
            (RunSortValue::Missing, _) => return Ordering::Greater,
            (_, RunSortValue::Missing) => return Ordering::Less,
            (RunSortValue::Integer(a), RunSortValue::Integer(b)) => a.cmp(b),
            (RunSortValue::Real(a), RunSortValue::Real(b)) => a.partial_cmp(b).unwrap_or(Ordering::Equal),
            (RunSortValue::Text(a), RunSortValue::Text(b)) => {
                a.bytes().map(|b| b.to_ascii_lowercase()).cmp(b.bytes().map(|b| b.to_ascii_lowercase()))
            }
            // One order has values of one kind.
            _ => Ordering::Equal,
        };
        direct(values.then_with(|| a.id.cmp(&b.id)))
    }
}

/// Position of a run in a list.
#[derive(Debug, Clone, PartialEq)]
pub struct RunPosition {
    /// Value that the list is sorted by.
    pub value: RunSortValue,
    /// Id of the run.
    pub id: String,
}

/// Runs of a page.
#[derive(Debug, Clone)]
pub struct ListedRuns {
    /// The runs, in order, without those that were deleted meanwhile.
    pub runs: Vec<RunRow>,
    /// Number of the runs that the page was made of.
    pub count: i64,
    /// Position of the last run; none on an empty page.
    pub last: Option<RunPosition>,
}

/// Group of runs that share a value.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct RunGroupRow {
    /// Value that its runs share; empty for runs without tags.
    pub value: String,
    /// Number of its runs.
    pub runs: i64,
    /// Number of their episodes.
    pub episodes: i64,
    /// Time of their latest results.
    pub last_results_at: Option<Millis>,
}

impl RunSortKey {
    const fn column(self) -> &'static str {
        match self {
            Self::Created => "r.created_at",
            Self::Name => "r.name COLLATE NOCASE",
            Self::Episodes => "coalesce(t.episodes, 0)",
            Self::LastResults => "t.last_results_at",
            Self::Skill => "t.skill",
        }
    }

    const fn may_be_missing(self) -> bool {
        matches!(self, Self::LastResults | Self::Skill)
    }

    fn value(self, row: &SqliteRow) -> Result<RunSortValue, sqlx::Error> {
        Ok(match self {
            Self::Created | Self::Episodes => RunSortValue::Integer(row.try_get("value")?),
            Self::Name => RunSortValue::Text(row.try_get("value")?),
            Self::LastResults => {
                row.try_get::<Option<i64>, _>("value")?.map_or(RunSortValue::Missing, RunSortValue::Integer)
            }
            Self::Skill => {
                row.try_get::<Option<f64>, _>("value")?.map_or(RunSortValue::Missing, RunSortValue::Real)
            }
        })
    }
}

/// Reads a page of the runs that match, after a position or from the start.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn page(
    conn: &mut SqliteConnection,
    filter: &RunFilter,
    order: RunOrder,
    after: Option<&RunPosition>,
    limit: i64,
) -> Result<ListedRuns, StoreError> {
    let mut statement = page_statement(filter, order, after, limit);
    let rows = statement.build().fetch_all(&mut *conn).await?;
    let ids: Vec<String> = rows.iter().map(|row| row.try_get("id")).collect::<Result<_, _>>()?;
    let last = rows.last().map(|row| {
        Ok::<_, sqlx::Error>(RunPosition { value: order.key.value(row)?, id: row.try_get("id")? })
    });
    let (runs, count) = (runs::of_ids(conn, &ids).await?, ids.len() as i64);
    Ok(ListedRuns { runs, count, last: last.transpose()? })
}

/// Returns the statement that selects the ids of a page and the values that they are sorted by.
fn page_statement(
    filter: &RunFilter,
    order: RunOrder,
    after: Option<&RunPosition>,
    limit: i64,
) -> QueryBuilder<Sqlite> {
    let mut statement = QueryBuilder::new("SELECT r.id, ");
    statement.push(order.key.column()).push(" AS value FROM runs r LEFT JOIN run_totals t ON t.run = r.id");
    push_filter(&mut statement, filter);
    if let Some(after) = after {
        push_position(&mut statement, order, after);
    }
    let direction = if order.is_descending { " DESC" } else { "" };
    statement.push(" ORDER BY ");
    if order.key.may_be_missing() {
        statement.push(order.key.column()).push(" IS NULL, ");
    }
    statement.push(order.key.column()).push(direction).push(", r.id").push(direction);
    statement.push(" LIMIT ").push_bind(limit);
    statement
}

/// Counts the runs that match.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn count(conn: &mut SqliteConnection, filter: &RunFilter) -> Result<i64, StoreError> {
    let mut statement =
        QueryBuilder::new("SELECT count(*) FROM runs r LEFT JOIN run_totals t ON t.run = r.id");
    push_filter(&mut statement, filter);
    Ok(statement.build_query_scalar().fetch_one(conn).await?)
}

/// Groups the runs that match, in alphabetical order of the groups. Results since the moment `since` make a run count as running.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn groups(
    conn: &mut SqliteConnection,
    filter: &RunFilter,
    grouping: RunGrouping,
    since: Millis,
) -> Result<Vec<RunGroupRow>, StoreError> {
    let mut statement = QueryBuilder::new("SELECT ");
    match grouping {
        RunGrouping::Strategy => statement.push("r.strategy"),
        RunGrouping::Tasks => statement.push("r.tasks"),
        RunGrouping::Tag => statement.push("coalesce(g.tag, '')"),
        RunGrouping::Activity => statement
            .push(
                "CASE WHEN r.archived_at IS NOT NULL THEN 'archived' WHEN r.status = 'paused' THEN 'paused'
                      WHEN t.last_results_at IS NULL THEN 'waiting' WHEN t.last_results_at >= ",
            )
            .push_bind(since)
            .push(" THEN 'running' ELSE 'idle' END"),
    };
    statement.push(
        " AS value, count(*) AS runs, coalesce(sum(t.episodes), 0) AS episodes, max(t.last_results_at) AS last_results_at
          FROM runs r LEFT JOIN run_totals t ON t.run = r.id",
    );
    if grouping == RunGrouping::Tag {
        statement.push(" LEFT JOIN run_tags g ON g.run = r.id");
    }
    push_filter(&mut statement, filter);
    statement.push(" GROUP BY 1 ORDER BY 1 LIMIT ").push_bind(MAX_GROUPS);
    Ok(statement.build_query_as().fetch_all(conn).await?)
}

/// Appends the condition that only runs after a position are read.
fn push_position(statement: &mut QueryBuilder<Sqlite>, order: RunOrder, after: &RunPosition) {
    let (column, sign) = (order.key.column(), if order.is_descending { " < " } else { " > " });
    if after.value == RunSortValue::Missing {
        statement.push(" AND ").push(column).push(" IS NULL AND r.id").push(sign).push_bind(after.id.clone());
        return;
    }
    statement.push(" AND ((").push(column).push(", r.id)").push(sign).push("(");
    match after.value.clone() {
        RunSortValue::Integer(value) => statement.push_bind(value),
        RunSortValue::Real(value) => statement.push_bind(value),
        RunSortValue::Text(value) => statement.push_bind(value),
        RunSortValue::Missing => statement.push("NULL"),
    };
    statement.push(", ").push_bind(after.id.clone()).push(")");
    if order.key.may_be_missing() {
        statement.push(" OR ").push(column).push(" IS NULL");
    }
    statement.push(")");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open_writer;

    /// Pages in the order of creation read the index from their position on. Other orders sort the values that the index and the totals
    /// have; none reads all runs with their settings.
    #[tokio::test]
    async fn pages_are_read_from_the_index() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut conn = open_writer(&folder.path().join("db")).await.expect("a database");
        for key in RunSortKey::ALL.iter().copied() {
            let value = match key {
                RunSortKey::Name => RunSortValue::Text(String::new()),
                RunSortKey::Skill => RunSortValue::Real(0.0),
                _ => RunSortValue::Integer(0),
            };
            let after = RunPosition { value, id: String::new() };
            for is_descending in [false, true] {
                let order = RunOrder { key, is_descending };
                let statement = page_statement(&RunFilter::default(), order, Some(&after), 10);
                let explain = format!("EXPLAIN QUERY PLAN {}", statement.sql().as_str());
                let plan =
                    sqlx::query(sqlx::AssertSqlSafe(explain)).fetch_all(&mut conn).await.expect("a plan");
                let steps: Vec<String> = plan.iter().map(|row| row.get("detail")).collect();
                let steps = steps.join("; ");
                assert!(steps.contains("USING INDEX runs_listed"), "{key}: {steps}");
                let is_sorted = steps.contains("USE TEMP B-TREE");
                assert_eq!(is_sorted, key != RunSortKey::Created, "{key}: {steps}");
            }
        }
    }
}
