//! Contents of a database, without what the time of day and random names decide.

use std::collections::BTreeMap;
use std::path::Path;

use sqlx::sqlite::{SqliteConnectOptions, SqliteRow};
use sqlx::{ConnectOptions, Row, SqliteConnection, ValueRef};

/// Tables that must be equal: everything that follows from the requests.
const TABLES: [&str; 21] = [
    "action_logs",
    "brackets",
    "critique_counters",
    "curriculum_events",
    "design_requests",
    "episodes",
    "failure_cells",
    "failure_examples",
    "failure_inertial_sectors",
    "gate_counts",
    "group_counters",
    "groups",
    "layout_transitions",
    "layouts",
    "leases",
    "level_moves",
    "proposals",
    "recipes",
    "run_settings",
    "scenarios",
    "task_counters",
];

/// Rows of each table, as text, in an order of their own.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct StoredState(BTreeMap<&'static str, Vec<String>>);

impl StoredState {
    /// Number of rows of a table.
    pub(super) fn rows(&self, table: &str) -> usize {
        self.0[table].len()
    }

    /// Compares two states, table by table.
    pub(super) fn assert_equal(&self, other: &Self, case: &str) {
        for (table, rows) in &self.0 {
            let others = &other.0[table];
            let first = rows.iter().zip(others).position(|(a, b)| a != b);
            assert!(
                rows == others,
                "{table} differs {case}: {} and {} rows, first at {first:?}: {:?} and {:?}",
                rows.len(),
                others.len(),
                first.map(|row| &rows[row]),
                first.map(|row| &others[row]),
            );
        }
    }
}

async fn connect(db: &Path) -> SqliteConnection {
    SqliteConnectOptions::new().filename(db).read_only(true).connect().await.unwrap()
}

/// True for times and random names, and for the numbers of failure cells: cells of one batch of critiques get them in order of their
/// keys, and the time of day decides which critiques are one batch.
fn is_ignored(table: &str, column: &str) -> bool {
    let is_cell = matches!((table, column), ("failure_cells", "id") | ("failure_examples", "cell"));
    let is_time = column == "at" || column == "latency_ms";
    is_cell || is_time || column.ends_with("_at") || column == "id_suffix"
}

/// Reads the tables of a database.
pub(super) async fn read_state(db: &Path) -> StoredState {
    let mut conn = connect(db).await;
    let mut state = BTreeMap::new();
    for table in TABLES {
        let columns: Vec<String> = sqlx::query_scalar("SELECT name FROM pragma_table_info(?)")
            .bind(table)
            .fetch_all(&mut conn)
            .await
            .unwrap();
        let columns: Vec<String> = columns.into_iter().filter(|name| !is_ignored(table, name)).collect();
        assert!(!columns.is_empty(), "{table} exists");
        let sql = format!("SELECT {} FROM {table}", columns.join(", "));
        let rows = sqlx::query(sqlx::AssertSqlSafe(sql)).fetch_all(&mut conn).await.unwrap();
        let mut rows: Vec<String> = rows.iter().map(|row| text(row, columns.len())).collect();
        rows.sort_unstable();
        state.insert(table, rows);
    }
    StoredState(state)
}

/// Text of a row with every bit of its values.
fn text(row: &SqliteRow, columns: usize) -> String {
    let value = |index: usize| {
        let raw = row.try_get_raw(index).unwrap();
        if raw.is_null() {
            return "null".to_owned();
        }
        match raw.type_info().to_string().as_str() {
            "INTEGER" => row.get::<i64, _>(index).to_string(),
            "REAL" => format!("{:x}", row.get::<f64, _>(index).to_bits()),
            "TEXT" => row.get::<String, _>(index),
            _ => format!("{:x?}", row.get::<Vec<u8>, _>(index)),
        }
    };
    (0..columns).map(value).collect::<Vec<_>>().join("|")
}

/// Messages of the events of a kind of all runs.
pub(super) async fn event_messages(db: &Path, kind: &str) -> Vec<String> {
    let sql = "SELECT body FROM run_events WHERE kind = ?";
    sqlx::query_scalar(sql).bind(kind).fetch_all(&mut connect(db).await).await.unwrap()
}
