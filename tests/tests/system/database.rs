//! Databases that cannot be used: one sentence that says what to do, exit code 2, and the file as it was.

use std::path::{Path, PathBuf};
use std::process::Command;

use sqlx::Connection;
use sqlx::sqlite::SqliteConnectOptions;
use system_tests::{Process, Server, binary};

fn refused(db: &Path) -> String {
    let out =
        Command::new(binary()).args(["serve", "--bind", "127.0.0.1:0", "--db"]).arg(db).output().unwrap();
    assert_eq!(out.status.code(), Some(2), "{out:?}");
    let stderr = String::from_utf8(out.stderr).unwrap();
    let told = stderr.lines().find(|l| l.starts_with("sparring: ")).unwrap_or_else(|| panic!("{stderr}"));
    told.replace(&db.display().to_string(), "DB")
}

async fn sql(db: &Path, statement: &'static str) {
    let options = SqliteConnectOptions::new().filename(db).create_if_missing(true);
    let mut conn = sqlx::SqliteConnection::connect_with(&options).await.unwrap();
    sqlx::query(statement).execute(&mut conn).await.unwrap();
    conn.close().await.unwrap();
}

#[tokio::test]
async fn not_a_database() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("notes.txt");
    let text = "these are my notes, and they are longer than a header. ".repeat(40);
    std::fs::write(&db, &text).unwrap();
    insta::assert_snapshot!(refused(&db), @"sparring: DB is not an SQLite database: give another path with --db, or move the file away");
    assert_eq!(std::fs::read_to_string(&db).unwrap(), text);
}

#[tokio::test]
async fn somebody_elses_database() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("other.sqlite3");
    sql(&db, "CREATE TABLE customers (name TEXT)").await;
    let before = std::fs::read(&db).unwrap();
    insta::assert_snapshot!(refused(&db), @"sparring: DB is a database, but not one of Sparring's: give another path with --db");
    let info = Command::new(binary()).args(["db", "info", "--db"]).arg(&db).output().unwrap();
    assert_eq!(info.status.code(), Some(2));
    assert_eq!(std::fs::read(&db).unwrap(), before, "what is not ours is not changed");
}

#[tokio::test]
async fn a_folder() {
    let folder = tempfile::tempdir().unwrap();
    insta::assert_snapshot!(refused(folder.path()), @"sparring: DB is no file: give the path of a file, which need not be there yet, with --db");
}

#[test]
fn a_start_that_is_refused_makes_no_database() {
    let folder = tempfile::tempdir().unwrap();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    for bind in ["0.0.0.0:0".to_owned(), taken.local_addr().unwrap().to_string()] {
        let db = folder.path().join("new.sqlite3");
        let out = Command::new(binary()).args(["serve", "--bind", &bind, "--db"]).arg(&db).output().unwrap();
        assert_eq!(out.status.code(), Some(2), "{out:?}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{bind}");
    }
}

/// What a server writes to a file that nobody finds any more is lost with it: it says so and takes nothing.
#[tokio::test]
async fn a_file_that_is_removed_or_replaced_under_its_server() {
    let server = Server::start().await;
    let api = server.api();
    let (db, aside) = (server.db(), server.db().with_extension("aside"));
    let made = |id: &'static str| api.post("/v1/runs", serde_json::json!({"id": id}));
    let _ = made("before").await.expect(201);
    std::fs::rename(&db, &aside).unwrap();
    let refused = made("nowhere").await.expect(503);
    assert!(refused["detail"].as_str().unwrap().contains("was removed or replaced"), "{refused}");
    tokio::time::sleep(std::time::Duration::from_millis(1100)).await; // it looks once a second
    let ready = api.get("/readyz").await.expect(503);
    assert!(ready["detail"].as_str().unwrap().contains("was removed or replaced"), "{ready}");
    std::fs::copy(&aside, &db).unwrap();
    let _ = made("elsewhere").await.expect(503);
    std::fs::rename(&aside, &db).unwrap();
    let _ = made("after").await.expect(201);
    let runs = api.get("/v1/runs").await.expect(200);
    let ids: Vec<_> =
        runs["runs"].as_array().unwrap().iter().map(|run| run["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["before", "after"]);
}

#[tokio::test]
async fn a_newer_schema() {
    let mut server = Server::start().await;
    server.stop().await;
    let statement = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
                     VALUES (9999, 'from the future', 1, x'00', 0)";
    sql(&server.db(), statement).await;
    let told = refused(&server.db());
    assert!(told.contains("newer Sparring (schema 9999, this one knows "), "{told}");
}

#[tokio::test]
async fn locked_by_another() {
    let mut server = Server::start().await;
    server.stop().await;
    let options = SqliteConnectOptions::new().filename(server.db());
    let mut conn = sqlx::SqliteConnection::connect_with(&options).await.unwrap();
    sqlx::query("BEGIN EXCLUSIVE").execute(&mut conn).await.unwrap();
    let db = server.db();
    let told = tokio::task::spawn_blocking(move || refused(&db)).await.unwrap();
    insta::assert_snapshot!(told, @"sparring: DB is locked by another process: stop the other server, or give another path with --db");
    sqlx::query("ROLLBACK").execute(&mut conn).await.unwrap();
    drop(Process::start(&server.db()));
}

#[tokio::test]
async fn a_database_is_served_once() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("one.sqlite3");
    let first = Process::start(&db);
    let told = refused(&db);
    assert!(told.contains("locked by another process: stop the other server"), "{told}");
    assert_eq!(first.api().get("/readyz").await.status, 200);
    first.kill(); // the system lets go of what a killed process held
    drop(Process::start(&db));
}

#[test]
fn a_place_that_is_not_there() {
    let folder = tempfile::tempdir().unwrap();
    insta::assert_snapshot!(refused(&folder.path().join("no/such/folder/x.sqlite3")), @"sparring: DB cannot be opened: the file or its folder does not exist or may not be opened");
}

/// Permissions do not bind root: there the server runs as nobody, from a copy that nobody may read.
#[cfg(unix)]
#[tokio::test]
async fn a_read_only_database() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    use std::os::unix::process::CommandExt;

    let mut server = Server::start().await;
    server.stop().await;
    let db = server.db();
    let folder = db.parent().unwrap();
    let permit = |path: &Path, mode| std::fs::set_permissions(path, PermissionsExt::from_mode(mode)).unwrap();
    let copy = folder.join("sparring");
    std::fs::copy(binary(), &copy).unwrap();
    permit(&db, 0o444);
    permit(&copy, 0o555);
    permit(folder, 0o555);
    let before = std::fs::read(&db).unwrap();
    let mut command = Command::new(&copy);
    if std::fs::metadata(&db).unwrap().uid() == 0 {
        command.uid(65534);
    }
    let out = command.args(["serve", "--bind", "127.0.0.1:0", "--db"]).arg(&db).output().unwrap();
    permit(folder, 0o755);
    assert_eq!(out.status.code(), Some(2), "{out:?}");
    let told = String::from_utf8(out.stderr).unwrap().replace(&db.display().to_string(), "DB");
    insta::assert_snapshot!(told.lines().last().unwrap(), @"sparring: DB cannot be written: check the permissions of the file and its folder");
    assert_eq!(std::fs::read(&db).unwrap(), before);
}

#[test]
fn addresses_that_strangers_reach_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = Command::new(binary())
        .args(["serve", "--bind", "0.0.0.0:0", "--db"])
        .arg(folder.path().join("x.sqlite3"))
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(2));
    let told = String::from_utf8(out.stderr).unwrap();
    assert!(told.contains("no tokens to keep strangers out"), "{told}");
}

/// A database as schema 8 had it.
fn old(folder: &Path) -> PathBuf {
    let db = folder.join("old.sqlite3");
    let stored = include_bytes!("../../fixtures/schema-8.sqlite3.gz");
    let mut file = std::fs::File::create(&db).unwrap();
    std::io::copy(&mut flate2::read::GzDecoder::new(&stored[..]), &mut file).unwrap();
    db
}

async fn count(db: &Path, statement: &'static str) -> i64 {
    let options = SqliteConnectOptions::new().filename(db).read_only(true);
    let mut conn = sqlx::SqliteConnection::connect_with(&options).await.unwrap();
    sqlx::query_scalar(statement).fetch_one(&mut conn).await.unwrap()
}

const SCHEMA: &str = "SELECT max(version) FROM _sqlx_migrations";

/// Before a database is changed for good it is copied; where that cannot be, it stays as it was.
#[tokio::test]
async fn an_older_database_is_copied_first() {
    let folder = tempfile::tempdir().unwrap();
    let db = old(folder.path());
    let copy = folder.path().join("old.sqlite3.schema-8");
    let before = std::fs::read(&db).unwrap();
    // Somebody else's folder is in the way.
    std::fs::create_dir_all(copy.join("full")).unwrap();
    let told = refused(&db);
    assert!(told.contains("DB has an older schema (8), and a copy of it could not be made"), "{told}");
    assert_eq!(count(&db, SCHEMA).await, 8);
    assert_eq!(std::fs::read(&db).unwrap(), before);
    assert!(!folder.path().join("old.sqlite3.schema-8.unfinished").exists());
    std::fs::remove_dir_all(&copy).unwrap();
    // What an attempt that was cut off left is in nobody's way.
    std::fs::write(folder.path().join("old.sqlite3.schema-8.unfinished"), "half").unwrap();
    drop(Process::start(&db));
    assert!(count(&db, SCHEMA).await > 8);
    assert_eq!((count(&copy, SCHEMA).await, count(&copy, "SELECT count(*) FROM action_logs").await), (8, 2));
    // Only what is older is copied.
    std::fs::remove_file(&copy).unwrap();
    drop(Process::start(&db));
    let beside = std::fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().file_name());
    assert!(beside.into_iter().all(|name| !name.to_string_lossy().contains("schema-")));
}

/// A run that another version began, whose logs and brackets were stored otherwise, goes on.
#[tokio::test]
async fn an_older_database_is_brought_on() {
    let folder = tempfile::tempdir().unwrap();
    let db = old(folder.path());
    let server = Process::start(&db);
    let api = server.api();
    let run = api.get("/v1/runs").await.expect(200)["runs"][0]["id"].as_str().unwrap().to_owned();
    let leases = api.get(&format!("/v1/runs/{run}/leases")).await.expect(200);
    assert_eq!(leases["leases"].as_array().unwrap().len(), 2);
    for lease in leases["leases"].as_array().unwrap() {
        let id = lease["lease"].as_str().unwrap();
        let shown = api.get(&format!("/v1/runs/{run}/leases/{id}")).await.expect(200);
        let bracket = &shown["groups"][0]["bracket"];
        assert!(bracket["floor"].as_f64().unwrap() < bracket["reference"].as_f64().unwrap(), "{bracket}");
        let path = format!("/v1/runs/{run}/episodes/ep_{id}_0");
        let episode = api.get(&path).await.expect(200);
        assert_eq!(episode["actions"]["steps"].as_array().unwrap().len(), 50, "{episode}");
        assert_eq!(api.get(&format!("{path}/critique")).await.status, 200);
        // The same log again is known to be the same.
        let result = serde_json::json!({"episode": format!("ep_{id}_0"), "actions": episode["actions"]});
        let receipt = &api.report(&run, vec![result]).await["results"][0];
        assert_eq!((&receipt["status"], &receipt["score"]), (&"duplicate".into(), &episode["score"]));
    }
    let _ = api.lease(&run, serde_json::json!({"groups": 8})).await;
    server.kill();
}
