//! A server that is killed while it deletes a run: the next server deletes the rest.

use std::path::Path;
use std::process::Command;

use serde_json::json;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, SqliteConnection};
use system_tests::{ApiClient, ServerProcess, sparring_binary, wait_until};

use super::{archive_and_delete, create, is_unknown_run};

/// Episodes of the deleted run.
const EPISODES: i64 = 3 * 64 * 16;

async fn open(db: &Path) -> SqliteConnection {
    SqliteConnectOptions::new().filename(db).read_only(true).connect().await.unwrap()
}

/// Counts the stored episodes of a run.
async fn count_episodes(db: &Path, run: &str) -> i64 {
    sqlx::query_scalar("SELECT count(*) FROM leases l JOIN episodes e ON e.lease = l.id WHERE l.run = ?")
        .bind(run)
        .fetch_one(&mut open(db).await)
        .await
        .unwrap()
}

/// Returns true if the row of a run is stored.
async fn is_stored(db: &Path, run: &str) -> bool {
    let found: Option<String> = sqlx::query_scalar("SELECT id FROM runs WHERE id = ?")
        .bind(run)
        .fetch_optional(&mut open(db).await)
        .await
        .unwrap();
    found.is_some()
}

/// Runs `sparring db check` with replays of all episodes of the other run.
fn check(db: &Path) {
    let args = ["db", "check", "--replay", "1000", "--db"];
    let output = Command::new(sparring_binary()).args(args).arg(db).output().unwrap();
    assert!(output.status.success(), "{output:?}");
}

async fn report_all(api: &ApiClient, run: &str, leases: u32, groups: u32) {
    for _ in 0..leases {
        let lease = api.lease(run, json!({ "groups": groups })).await;
        api.report(run, lease.results("hold")).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn killed_server_deletes_the_rest_after_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("killed.sqlite3");
    let mut server = ServerProcess::start(&db);
    let api = server.api();
    create(&api, "kept", json!({})).await;
    report_all(&api, "kept", 2, 8).await;
    create(&api, "gone", json!({"group_size": 16})).await;
    report_all(&api, "gone", 3, 64).await;
    assert_eq!(count_episodes(&db, "gone").await, EPISODES);
    archive_and_delete(&api, "gone").await;
    server.kill();

    let left = count_episodes(&db, "gone").await;
    assert!(is_stored(&db, "gone").await && left > 0, "{left} episodes are left");
    check(&db);
    server = ServerProcess::start(&db);
    assert!(is_unknown_run(&server.api().get("/v1/runs/gone").await));
    wait_until("some more episodes are deleted", async || count_episodes(&db, "gone").await < left).await;
    server.kill();
    check(&db);

    server = ServerProcess::start(&db);
    wait_until("the run is deleted", async || !is_stored(&db, "gone").await).await;
    assert_eq!(count_episodes(&db, "gone").await, 0);
    assert_eq!(count_episodes(&db, "kept").await, 2 * 8 * 2);
    let api = server.api();
    report_all(&api, "kept", 1, 8).await;
    assert_eq!(server.terminate(), Some(0));
    check(&db);
}
