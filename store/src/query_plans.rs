//! Test of the query plans of all statements: a run of weeks has millions of rows, and a statement that reads them all works for a
//! day, then slows everything down.

use std::path::Path;

use sqlx::Row;

/// True if a step of a plan may read more than one row of a table: the whole table, or all rows of a run or a lease.
fn reads_many_rows(step: &str) -> bool {
    let scans = step.starts_with("SCAN ") && !step.contains("VIRTUAL TABLE") && !step.contains("(subquery");
    let reads_all_of_one = ["(run=?)", "(lease=?)"].iter().any(|key| step.ends_with(key));
    scans || step.starts_with("SEARCH ") && reads_all_of_one
}

/// True if a page is sorted after all of its rows were read: the cost of a list grows with the table.
fn sorts_page(statement: &str, step: &str) -> bool {
    statement.contains("LIMIT") && step == "USE TEMP B-TREE FOR ORDER BY"
}

/// The snapshot lists every statement that reads many rows or sorts a page. A new one must read few rows (a queue, a ring, a
/// lease), or serve a page of a list.
#[tokio::test]
async fn statements_that_read_many_rows_are_known() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut conn = super::open_writer(&folder.path().join("db")).await.expect("a database");
    let mut known = Vec::new();
    let described = Path::new(env!("CARGO_MANIFEST_DIR")).join("../.sqlx");
    for file in std::fs::read_dir(described).expect("the folder").map(|entry| entry.expect("a file").path()) {
        let text = std::fs::read_to_string(file).expect("a description");
        let described: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let statement = described["query"].as_str().expect("a statement").to_owned();
        let plan = sqlx::query(sqlx::AssertSqlSafe(format!("EXPLAIN QUERY PLAN {statement}")))
            .fetch_all(&mut conn)
            .await;
        let steps = plan.expect("a plan").into_iter().map(|row| row.get::<String, _>("detail"));
        let costly: Vec<String> =
            steps.filter(|step| reads_many_rows(step) || sorts_page(&statement, step)).collect();
        if !costly.is_empty() {
            let words: Vec<&str> = statement.split_whitespace().collect();
            known.push(format!("{}\n    {}", words.join(" "), costly.join("\n    ")));
        }
    }
    known.sort();
    insta::assert_snapshot!(known.join("\n\n"));
}
