//! No row of a deleted run stays, and no row of another run changes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::json;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, SqliteConnection};
use system_tests::{ApiClient, Server, wait_until};

use super::populate::create_populated_run;
use super::{archive, archive_and_delete, create};

/// Tables whose rows belong to no run.
const SERVER_TABLES: [&str; 7] = [
    "_sqlx_migrations",
    "audit_log",
    "highest_deleted_lease",
    "principals",
    "sqlite_sequence",
    "used_run_seeds",
    "write_probe",
];

/// Tables whose rows workers delete at any moment.
const QUEUES: [&str; 2] = ["critique_queue", "rollout_leases"];

/// Rows of each table as text.
pub(crate) type Dump = BTreeMap<String, BTreeSet<String>>;

/// Reads all rows of all tables with data of runs.
pub(crate) async fn dump(db: &Path) -> Dump {
    let mut conn = SqliteConnectOptions::new().filename(db).read_only(true).connect().await.unwrap();
    let tables = sqlx::query_scalar::<_, String>("SELECT name FROM sqlite_schema WHERE type = 'table'");
    let mut dump = Dump::new();
    for table in tables.fetch_all(&mut conn).await.unwrap() {
        if !SERVER_TABLES.contains(&table.as_str()) {
            let rows = dump_table(&mut conn, &table).await;
            dump.insert(table, rows);
        }
    }
    dump
}

async fn dump_table(conn: &mut SqliteConnection, table: &str) -> BTreeSet<String> {
    let columns = sqlx::query_scalar::<_, String>("SELECT name FROM pragma_table_info(?)").bind(table);
    let columns: Vec<String> = columns.fetch_all(&mut *conn).await.unwrap();
    let quoted: Vec<String> = columns.iter().map(|column| format!("quote({column})")).collect();
    let rows = AssertSqlSafe(format!("SELECT json_array({}) FROM {table}", quoted.join(", ")));
    sqlx::query_scalar::<_, String>(rows).fetch_all(conn).await.unwrap().into_iter().collect()
}

/// Marks the runs as a second run with their seed does.
async fn mark_seed_reused(db: &Path) {
    let mut conn = SqliteConnectOptions::new().filename(db).connect().await.unwrap();
    sqlx::query("UPDATE runs SET is_seed_reused = 1").execute(&mut conn).await.unwrap();
    conn.close().await.unwrap();
}

/// Inserts rows into tables that a short test does not fill.
async fn insert_rare_rows(db: &Path) {
    let mut conn = SqliteConnectOptions::new().filename(db).connect().await.unwrap();
    for statement in [
        "INSERT INTO level_moves VALUES ('gone', 1, 'kessler/survival', 'up', 0, 1, '{}', 0)",
        "INSERT INTO deleted_run_events VALUES ('gone', 0)",
        "INSERT INTO alerts (rule, run, subject, message, began_at, ended_at) VALUES ('level_down', 'gone', '', 'down', 1, 1)",
        "INSERT INTO principals (id, name) VALUES (1, 'member')",
        "INSERT INTO run_members VALUES ('gone', 1)",
        "INSERT INTO rollout_spend VALUES ('gone', 0, 1, 1, 0.5)",
        "INSERT INTO task_curve_blocks VALUES ('gone', 'kessler/survival', 0, 0, x'5b5d')",
        "INSERT INTO audit_samples (lease, number, scenario, is_contested, is_slot)
         SELECT l.id, 999, g.scenario, 0, 0 FROM leases l JOIN groups g ON g.lease = l.id WHERE l.run = 'gone' LIMIT 1",
        "INSERT INTO step_verdicts (at, run, episode, scenario, task, step, model, prompt_version, error, is_cached,
                                    tokens_in, tokens_out, cost, latency_ms)
         VALUES (0, 'gone', 'e', x'00', 'kessler/survival', 1, 'm', '1', 'none', 0, 0, 0, 0.0, 0)",
    ] {
        sqlx::query(statement).execute(&mut conn).await.unwrap();
    }
    conn.close().await.unwrap();
}

/// Counts the scenarios that both runs have leased.
async fn count_shared_scenarios(db: &Path) -> i64 {
    let mut conn = SqliteConnectOptions::new().filename(db).read_only(true).connect().await.unwrap();
    let count = sqlx::query_scalar(
        "SELECT count(*) FROM (SELECT g.scenario FROM groups g JOIN leases l ON l.id = g.lease
                               GROUP BY g.scenario HAVING count(DISTINCT l.run) > 1)",
    );
    count.fetch_one(&mut conn).await.unwrap()
}

/// Creates a run with results that no worker changes any more.
async fn create_finished_run(api: &ApiClient) {
    let settings = json!({"tags": ["first"], "contested_share": 1.0, "seed": 11, "target": "mastery"});
    create(api, "kept", settings).await;
    let lease = api.lease("kept", json!({"groups": 6})).await;
    api.report("kept", lease.results("hold")).await;
    wait_until("all episodes are criticised", async || {
        api.get("/v1/runs/kept").await.expect(200)["critique_backlog"]["waiting"] == 0
    })
    .await;
    archive(api, "kept").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn deletion_leaves_the_database_as_before_the_run() {
    let mut server = Server::start().await;
    create_finished_run(&server.api()).await;
    // Scenarios of the archived run that are being prepared are lost by the restart, and are not prepared again.
    server.restart().await;
    let api = server.api();
    mark_seed_reused(&server.db_path()).await;
    let before = dump(&server.db_path()).await;
    // The same seed as the other run: both share scenarios.
    let _ = create_populated_run(&api, "gone").await;
    let retention = json!({"episodes": 8});
    let _ = api.send_json("PUT", "/v1/runs/gone/retention", retention).await.expect(200);
    wait_until("leases are compacted", async || {
        !dump(&server.db_path()).await["compacted_leases"].is_empty()
    })
    .await;
    server.stop().await;
    insert_rare_rows(&server.db_path()).await;
    server.restart().await;
    let api = server.api();
    let full = dump(&server.db_path()).await;
    assert!(count_shared_scenarios(&server.db_path()).await > 0);
    let untouched = full.keys().filter(|table| full[*table] == before[*table]);
    let untouched: Vec<&String> = untouched.filter(|table| !QUEUES.contains(&table.as_str())).collect();
    assert_eq!(untouched, ["denials", "shard", "tokens"], "all other tables have rows of the run");

    archive_and_delete(&api, "gone").await;
    wait_until("the run is deleted", async || dump(&server.db_path()).await["runs"] == before["runs"]).await;
    let after = dump(&server.db_path()).await;
    for (table, rows) in &before {
        let changed: Vec<&String> = after[table].symmetric_difference(rows).collect();
        assert!(changed.is_empty(), "{table}: {changed:?}");
    }
    server.stop().await;
}
