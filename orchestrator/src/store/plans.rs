//! How SQLite finds what statements ask for: a run of weeks has millions of rows, and a statement that walks through them all
//! works for a day, then slows everything down.

use std::path::Path;

use sqlx::Row;

/// Steps of a plan that may walk through more than one row of a table: everything, or all of a run or a lease.
fn walks(step: &str) -> bool {
    let whole = step.starts_with("SCAN ") && !step.contains("VIRTUAL TABLE") && !step.contains("(subquery");
    let of_one = ["(run=?)", "(lease=?)"].iter().any(|key| step.ends_with(key));
    whole || step.starts_with("SEARCH ") && of_one
}

/// Whether a page is sorted after all of it was found: what a list costs grows with what there is.
fn sorts(statement: &str, step: &str) -> bool {
    statement.contains("LIMIT") && step == "USE TEMP B-TREE FOR ORDER BY"
}

/// Every statement that walks, or sorts for a page, is here, to be looked at by whoever adds one: it walks through little (what waits, a ring, a
/// lease), or it is for somebody who asks for a page of it.
#[tokio::test]
async fn statements_that_walk_are_known() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut conn = super::writer(&folder.path().join("db")).await.expect("a database");
    let mut known = Vec::new();
    let described = Path::new(env!("CARGO_MANIFEST_DIR")).join("../.sqlx");
    for file in std::fs::read_dir(described).expect("descriptions").map(|entry| entry.expect("one").path()) {
        let text = std::fs::read_to_string(file).expect("a description");
        let described: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let statement = described["query"].as_str().expect("a statement").to_owned();
        let plan = sqlx::query(sqlx::AssertSqlSafe(format!("EXPLAIN QUERY PLAN {statement}")))
            .fetch_all(&mut conn)
            .await;
        let steps = plan.expect("a plan").into_iter().map(|row| row.get::<String, _>("detail"));
        let walks: Vec<String> = steps.filter(|step| walks(step) || sorts(&statement, step)).collect();
        if !walks.is_empty() {
            let words: Vec<&str> = statement.split_whitespace().collect();
            known.push(format!("{}\n    {}", words.join(" "), walks.join("\n    ")));
        }
    }
    known.sort();
    insta::assert_snapshot!(known.join("\n\n"));
}
