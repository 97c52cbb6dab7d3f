//! Unusable databases: the server exits with code 2 and one sentence that says what to do, and leaves the file unchanged.

use std::path::Path;
use std::process::Command;

use sqlx::Connection;
use sqlx::sqlite::SqliteConnectOptions;
use system_tests::{Server, ServerProcess, sparring_binary, wait_for};

fn serve_error(db: &Path) -> String {
    let process = Command::new(sparring_binary())
        .args(["serve", "--bind", "127.0.0.1:0", "--db"])
        .arg(db)
        .output()
        .unwrap();
    assert_eq!(process.status.code(), Some(2), "{process:?}");
    let stderr = String::from_utf8(process.stderr).unwrap();
    let error = stderr.lines().find(|l| l.starts_with("sparring: ")).unwrap_or_else(|| panic!("{stderr}"));
    error.replace(&db.display().to_string(), "DB")
}

async fn execute_sql(db: &Path, statement: &'static str) {
    let options = SqliteConnectOptions::new().filename(db).create_if_missing(true);
    let mut conn = sqlx::SqliteConnection::connect_with(&options).await.unwrap();
    sqlx::query(statement).execute(&mut conn).await.unwrap();
    conn.close().await.unwrap();
}

#[tokio::test]
async fn file_that_is_no_database_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("notes.txt");
    let text = "these are my notes, and they are longer than a header. ".repeat(40);
    std::fs::write(&db, &text).unwrap();
    insta::assert_snapshot!(serve_error(&db), @"sparring: DB is not an SQLite database: give another path with --db, or move the file away");
    assert_eq!(std::fs::read_to_string(&db).unwrap(), text);
}

#[tokio::test]
async fn database_of_another_program_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("other.sqlite3");
    execute_sql(&db, "CREATE TABLE customers (name TEXT)").await;
    let before = std::fs::read(&db).unwrap();
    insta::assert_snapshot!(serve_error(&db), @"sparring: DB is a database of another application: give another path with --db");
    let info = Command::new(sparring_binary()).args(["db", "info", "--db"]).arg(&db).output().unwrap();
    assert_eq!(info.status.code(), Some(2));
    assert_eq!(std::fs::read(&db).unwrap(), before, "the file is unchanged");
}

#[tokio::test]
async fn folder_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    insta::assert_snapshot!(serve_error(folder.path()), @"sparring: DB is not a file: give the path of a new or existing file with --db");
}

#[test]
fn failed_start_creates_no_database() {
    let folder = tempfile::tempdir().unwrap();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    for bind in ["0.0.0.0:0".to_owned(), taken.local_addr().unwrap().to_string()] {
        let db = folder.path().join("new.sqlite3");
        let process = Command::new(sparring_binary())
            .args(["serve", "--bind", &bind, "--db"])
            .arg(&db)
            .output()
            .unwrap();
        assert_eq!(process.status.code(), Some(2), "{process:?}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{bind}");
    }
}

/// Writes to an unlinked file would be lost: the server rejects writes until the file is back.
#[tokio::test]
async fn server_rejects_writes_while_its_file_is_replaced() {
    let server = Server::start().await;
    let api = server.api();
    let (db, aside) = (server.db_path(), server.db_path().with_extension("aside"));
    let create_run = |id: &'static str| api.post("/v1/runs", serde_json::json!({"id": id}));
    let _ = create_run("before").await.expect(201);
    std::fs::rename(&db, &aside).unwrap();
    let rejected = create_run("nowhere").await.expect(503);
    assert!(rejected["detail"].as_str().unwrap().contains("was removed or replaced"), "{rejected}");
    // The server checks the file once a second.
    let ready = wait_for("the server is not ready", async || {
        let response = api.get("/readyz").await;
        (response.status == 503).then_some(response.body)
    });
    let ready = ready.await;
    assert!(ready["detail"].as_str().unwrap().contains("was removed or replaced"), "{ready}");
    std::fs::copy(&aside, &db).unwrap();
    let _ = create_run("elsewhere").await.expect(503);
    std::fs::rename(&aside, &db).unwrap();
    // The server probes the file twice a second until it can write again.
    wait_for("the server writes again", async || {
        let response = create_run("after").await;
        assert!(matches!(response.status, 201 | 503), "{response:?}");
        (response.status == 201).then_some(())
    })
    .await;
    let runs = api.get("/v1/runs").await.expect(200);
    let ids: Vec<_> =
        runs["runs"].as_array().unwrap().iter().map(|run| run["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["before", "after"]);
}

#[tokio::test]
async fn newer_schema_is_rejected() {
    let mut server = Server::start().await;
    server.stop().await;
    let statement = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
                     VALUES (9999, 'from the future', 1, x'00', 0)";
    execute_sql(&server.db_path(), statement).await;
    let error = serve_error(&server.db_path());
    assert!(error.contains("newer Sparring (schema 9999, this one knows "), "{error}");
}

#[tokio::test]
async fn locked_database_is_rejected() {
    let mut server = Server::start().await;
    server.stop().await;
    let options = SqliteConnectOptions::new().filename(server.db_path());
    let mut conn = sqlx::SqliteConnection::connect_with(&options).await.unwrap();
    sqlx::query("BEGIN EXCLUSIVE").execute(&mut conn).await.unwrap();
    let db = server.db_path();
    let error = tokio::task::spawn_blocking(move || serve_error(&db)).await.unwrap();
    insta::assert_snapshot!(error, @"sparring: DB is locked by another process: stop the other server, or give another path with --db");
    sqlx::query("ROLLBACK").execute(&mut conn).await.unwrap();
    drop(ServerProcess::start(&server.db_path()));
}

#[tokio::test]
async fn database_has_one_server() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("one.sqlite3");
    let first = ServerProcess::start(&db);
    let error = serve_error(&db);
    assert!(error.contains("locked by another process: stop the other server"), "{error}");
    assert_eq!(first.api().get("/readyz").await.status, 200);
    first.kill(); // the operating system releases the lock of a killed process
    drop(ServerProcess::start(&db));
}

#[test]
fn missing_folder_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    insta::assert_snapshot!(serve_error(&folder.path().join("no/such/folder/x.sqlite3")), @"sparring: DB cannot be created: its folder does not exist; create the folder, or give another path with --db");
}

/// Permissions do not bind root. As root, the test runs a copy of the server as the unprivileged user 65534.
#[cfg(unix)]
#[tokio::test]
async fn read_only_database_is_rejected() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    use std::os::unix::process::CommandExt;

    let mut server = Server::start().await;
    server.stop().await;
    let db = server.db_path();
    let folder = db.parent().unwrap();
    let permit = |path: &Path, mode| std::fs::set_permissions(path, PermissionsExt::from_mode(mode)).unwrap();
    let copy = folder.join("sparring");
    std::fs::copy(sparring_binary(), &copy).unwrap();
    permit(&db, 0o444);
    permit(&copy, 0o555);
    permit(folder, 0o555);
    let before = std::fs::read(&db).unwrap();
    let mut command = Command::new(&copy);
    if std::fs::metadata(&db).unwrap().uid() == 0 {
        command.uid(65534);
    }
    let process = command.args(["serve", "--bind", "127.0.0.1:0", "--db"]).arg(&db).output().unwrap();
    permit(folder, 0o755);
    assert_eq!(process.status.code(), Some(2), "{process:?}");
    let error = String::from_utf8(process.stderr).unwrap().replace(&db.display().to_string(), "DB");
    insta::assert_snapshot!(error.lines().last().unwrap(), @"sparring: DB cannot be written: check the permissions of the file and its folder");
    assert_eq!(std::fs::read(&db).unwrap(), before);
}

#[test]
fn public_address_without_tokens_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let process = Command::new(sparring_binary())
        .args(["serve", "--bind", "0.0.0.0:0", "--db"])
        .arg(folder.path().join("x.sqlite3"))
        .output()
        .unwrap();
    assert_eq!(process.status.code(), Some(2));
    let error = String::from_utf8(process.stderr).unwrap();
    assert!(error.contains("the server has no tokens"), "{error}");
}
