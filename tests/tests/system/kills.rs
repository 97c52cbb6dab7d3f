//! SIGKILL while a database is migrated and while it is vacuumed: the next command continues, and nothing is lost.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::json;
use sqlx::migrate::Migrator;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection, SqliteConnection};
use system_tests::{ServerProcess, sparring_binary};

/// Kills of each test, at moments that are spread over the duration of the work.
const KILLS: u32 = 12;
/// Rows that make the work long enough.
const ROWS: i64 = 60_000;

async fn open(db: &Path) -> SqliteConnection {
    SqliteConnectOptions::new().filename(db).create_if_missing(true).connect().await.unwrap()
}

async fn number(conn: &mut SqliteConnection, query: &'static str) -> i64 {
    sqlx::query_scalar(query).fetch_one(conn).await.unwrap()
}

/// Checks that a database is intact and has all rows, and returns its schema version.
async fn assert_complete(db: &Path) -> i64 {
    let mut conn = open(db).await;
    let integrity: String = sqlx::query_scalar("PRAGMA integrity_check").fetch_one(&mut conn).await.unwrap();
    assert_eq!(integrity, "ok");
    assert_eq!(number(&mut conn, "SELECT count(*) FROM audit_log").await, ROWS);
    let schema = number(&mut conn, "SELECT max(version) FROM _sqlx_migrations").await;
    conn.close().await.unwrap();
    schema
}

/// Copies a database that no process uses.
fn copy_database(from: &Path, to: &Path) {
    for ending in ["-wal", "-shm", ".schema-1", ".schema-1.unfinished"] {
        let _ = std::fs::remove_file(format!("{}{ending}", to.display()));
    }
    std::fs::copy(from, to).unwrap();
}

/// Runs a command and kills it after a time.
fn kill_after(args: &[&str], db: &Path, lifetime: Duration) {
    let mut command = Command::new(sparring_binary());
    command.args(args).arg("--db").arg(db).stdout(Stdio::null()).stderr(Stdio::null());
    let mut process = command.spawn().unwrap();
    // Tests the passing of time: the kill comes at another moment of the work each time.
    std::thread::sleep(lifetime);
    process.kill().unwrap();
    process.wait().unwrap();
}

fn assert_check_succeeds(db: &Path) {
    let check = Command::new(sparring_binary()).args(["db", "check", "--db"]).arg(db).output().unwrap();
    assert_eq!(check.status.code(), Some(0), "{}", String::from_utf8_lossy(&check.stdout));
}

/// Settings of a run, as this version stores them.
async fn stored_settings(folder: &Path) -> String {
    let db = folder.join("settings.sqlite3");
    let server = ServerProcess::start(&db);
    let _ = server.api().post("/v1/runs", json!({"strategy": "ladder", "id": "run"})).await.expect(201);
    assert_eq!(server.terminate(), Some(0));
    sqlx::query_scalar("SELECT settings FROM runs").fetch_one(&mut open(&db).await).await.unwrap()
}

/// Creates a database of the first schema with a run and many rows.
async fn create_old_database(folder: &Path) -> PathBuf {
    let settings = stored_settings(folder).await;
    let migrations = folder.join("migrations");
    std::fs::create_dir(&migrations).unwrap();
    let name = "0001_initial.sql";
    let all = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../migrations"));
    std::fs::copy(all.join(name), migrations.join(name)).unwrap();
    let db = folder.join("old.sqlite3");
    let mut conn = open(&db).await;
    Migrator::new(migrations).await.unwrap().run(&mut conn).await.unwrap();
    let run = "INSERT INTO runs (id, name, seed, status, settings, created_at) VALUES ('run', 'run', 1, 'active', ?, 0)";
    sqlx::query(run).bind(settings).execute(&mut conn).await.unwrap();
    for rows in [
        "INSERT INTO leases (id, id_suffix, run, purpose, status, groups, group_size, policy_version, ttl_ms, created_at, expires_at)
         SELECT value, 'abcdef', 'run', 'train', 'released', 1, 1, 0, 1000, 0, 1000 FROM rows",
        "INSERT INTO audit_log (at, operation, path, status, request_id) SELECT 0, 'GET /', '/', 200, hex(randomblob(40)) FROM rows",
    ] {
        let rows = format!(
            "WITH RECURSIVE rows (value) AS (SELECT 1 UNION ALL SELECT value + 1 FROM rows WHERE value < {ROWS}) {rows}"
        );
        sqlx::query(sqlx::AssertSqlSafe(rows)).execute(&mut conn).await.unwrap();
    }
    conn.close().await.unwrap();
    db
}

#[tokio::test(flavor = "multi_thread")]
async fn kills_during_migration_lose_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let old = create_old_database(folder.path()).await;
    let db = folder.path().join("db.sqlite3");
    copy_database(&old, &db);
    let start = Instant::now();
    drop(ServerProcess::start(&db));
    let duration = start.elapsed();
    let (newest, mut unfinished) = (assert_complete(&db).await, 0);
    for kill in 0..KILLS {
        copy_database(&old, &db);
        kill_after(&["serve", "--bind", "127.0.0.1:0"], &db, duration * kill / KILLS);
        let schema = assert_complete(&db).await;
        unfinished += u32::from(schema < newest);
        let copy = folder.path().join("db.sqlite3.schema-1");
        if copy.exists() {
            assert_eq!(assert_complete(&copy).await, 1, "the copy before the migration is complete");
        }
        assert!(schema == 1 || copy.exists(), "a database is migrated after it was copied");
        let server = ServerProcess::start(&db);
        assert_eq!(server.api().get("/readyz").await.status, 200);
        let _ = server.api().get("/v1/runs/run/mastery").await.expect(200);
        assert_eq!(server.terminate(), Some(0));
        assert_eq!(assert_complete(&db).await, newest);
    }
    assert!(unfinished > 0, "no kill came before the end of the migration, which takes {duration:?}");
    assert_check_succeeds(&db);
}

#[tokio::test(flavor = "multi_thread")]
async fn kills_during_vacuum_lose_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, db) = (folder.path().join("whole.sqlite3"), folder.path().join("db.sqlite3"));
    let server = ServerProcess::start(&whole);
    let api = server.api();
    let _ = api
        .post("/v1/runs", json!({"strategy": "ladder", "id": "run", "tasks": ["kessler/survival"]}))
        .await
        .expect(201);
    let lease = api.lease("run", json!({"groups": 4})).await;
    let _ = api.report("run", lease.results("hold")).await;
    assert_eq!(server.terminate(), Some(0));
    let mut conn = open(&whole).await;
    let rows = format!(
        "WITH RECURSIVE rows (value) AS (SELECT 1 UNION ALL SELECT value + 1 FROM rows WHERE value < 2 * {ROWS})
         INSERT INTO audit_log (at, operation, path, status, request_id)
         SELECT 0, 'GET /', '/', 200, hex(randomblob(200)) FROM rows;
         DELETE FROM audit_log WHERE id % 2 = 0;
         DELETE FROM audit_log WHERE id > (SELECT id FROM audit_log ORDER BY id LIMIT 1 OFFSET {});",
        ROWS - 1
    );
    sqlx::raw_sql(sqlx::AssertSqlSafe(rows)).execute(&mut conn).await.unwrap();
    conn.close().await.unwrap();
    copy_database(&whole, &db);
    let before = std::fs::metadata(&db).unwrap().len();
    let duration = vacuum_duration(&db);
    for kill in 0..KILLS {
        copy_database(&whole, &db);
        kill_after(&["db", "vacuum"], &db, duration * kill / KILLS);
        assert_complete(&db).await;
        assert_check_succeeds(&db);
    }
    let _ = vacuum_duration(&db);
    assert!(std::fs::metadata(&db).unwrap().len() < before, "the file shrinks");
    let server = ServerProcess::start(&db);
    let episodes = server.api().get("/v1/runs/run/episodes?limit=500").await.expect(200);
    assert_eq!(episodes["episodes"].as_array().unwrap().len(), 4);
}

/// Vacuums a database and returns how long it took.
fn vacuum_duration(db: &Path) -> Duration {
    let start = Instant::now();
    let done = Command::new(sparring_binary()).args(["db", "vacuum", "--db"]).arg(db).output().unwrap();
    assert_eq!(done.status.code(), Some(0), "{done:?}");
    start.elapsed()
}
