//! `sparring db`: subcommands next to a running server, and on damaged databases.

mod deep_check;
mod export_tables;

use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::{Value, json};
use sqlx::ConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;
use system_tests::{ServerProcess, sparring_binary, wait_until};

fn db(file: &Path, args: &[&str]) -> Output {
    Command::new(sparring_binary()).args(["db"]).args(args).arg("--db").arg(file).output().unwrap()
}

fn output_text(out: &Output) -> String {
    String::from_utf8([out.stdout.clone(), out.stderr.clone()].concat()).unwrap()
}

fn assert_output(output: &Output, status: i32, text: &str) {
    let printed = output_text(output);
    assert!(output.status.code() == Some(status) && printed.contains(text), "{:?} {printed}", output.status);
}

/// Starts a server with a run of 24 episodes and waits until retention has compacted some of them.
async fn serve_compacted_run(file: &Path) -> ServerProcess {
    let server = ServerProcess::start(file);
    let api = server.api();
    let settings = json!({"id": "run", "seed": 5, "placement": false, "tasks": ["kessler/survival"], "retention": {"episodes": 4},
                      "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    for _ in 0..6 {
        let lease = api.lease("run", json!({"groups": 4})).await;
        let _ = api.report("run", lease.results("heuristic")).await;
    }
    wait_until("an episode is compacted", async || {
        let listed = api.get("/v1/runs/run/episodes?limit=500").await.expect(200);
        listed["episodes"].as_array().unwrap().iter().any(|episode| episode["replay"] == "expired")
    })
    .await;
    server
}

#[tokio::test(flavor = "multi_thread")]
async fn info_check_backup_and_export_work_on_a_live_database() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("db.sqlite3");
    let server = serve_compacted_run(&file).await;
    let copy = folder.path().join("copy.sqlite3");

    let info: Value = serde_json::from_slice(&db(&file, &["info", "--json"]).stdout).unwrap();
    let run = &info["runs"][0];
    assert_eq!(run["whole"].as_i64().unwrap() + run["compacted"].as_i64().unwrap(), 24, "{info}");
    assert!(run["compacted"].as_i64().unwrap() > 0 && info["bytes"].as_i64().unwrap() > 0);
    assert!(output_text(&db(&file, &["info"])).contains("table, with its indexes"));
    let checked = db(&file, &["check"]);
    assert_eq!(checked.status.code(), Some(0), "{}", output_text(&checked));

    assert_eq!(db(&file, &["backup", copy.to_str().unwrap()]).status.code(), Some(0));
    let second = db(&file, &["backup", copy.to_str().unwrap()]);
    assert_output(&second, 2, "already exists");
    assert_output(
        &db(&file, &["backup", "/nowhere/copy.sqlite3"]),
        2,
        "cannot be written: its folder does not exist",
    );

    assert_export_is_complete(&file, &folder.path().join("lines.ndjson"));

    assert_output(&db(&file, &["vacuum"]), 2, "stop the other server");
    assert_eq!(server.terminate(), Some(0));
    assert_output(&db(&file, &["vacuum"]), 0, ", before ");
    // A server can continue from the copy.
    let checked = db(&copy, &["check"]);
    assert_eq!(checked.status.code(), Some(0), "{}", output_text(&checked));
    let server = ServerProcess::start(&copy);
    let episodes = server.api().get("/v1/runs/run/episodes?limit=500").await.expect(200);
    assert_eq!(episodes["episodes"].as_array().unwrap().len(), 24);
    let _ = server.api().lease("run", json!({"groups": 2})).await;
}

/// Checks an export of all 24 episodes: to a file with actions, and to stdout.
fn assert_export_is_complete(file: &Path, out: &Path) {
    let export = db(file, &["export", "--run", "run", "--actions", "--out", out.to_str().unwrap()]);
    assert_eq!(export.status.code(), Some(0), "{}", output_text(&export));
    let text = std::fs::read_to_string(out).unwrap();
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!((&lines[0]["kind"], &lines[0]["run"]), (&json!("run"), &json!("run")));
    let episodes: Vec<&Value> = lines.iter().filter(|line| line["kind"] == "episode").collect();
    assert_eq!(episodes.len(), 24);
    for episode in &episodes {
        let is_whole = episode["replay"] == "available";
        assert!(
            episode["score"].is_f64()
                && episode["scenario"].is_object() == is_whole
                && episode["actions"].is_array() == is_whole
        );
    }
    let piped = db(file, &["export"]).stdout;
    assert_eq!(String::from_utf8(piped).unwrap().lines().count(), lines.len());
    let by_prefix = db(file, &["export", "--run", "ru"]).stdout;
    assert_eq!(String::from_utf8(by_prefix).unwrap().lines().count(), lines.len());
    assert_output(&db(file, &["export", "--run", "unknown"]), 2, "there is no run \"unknown\"");
}

/// Copies a database beside itself and damages the copy by SQL.
async fn damage_copy(file: &Path, damage: &'static str) -> PathBuf {
    let damaged = file.with_file_name("harmed.sqlite3");
    let _ = std::fs::remove_file(&damaged);
    std::fs::copy(file, &damaged).unwrap();
    let mut conn = SqliteConnectOptions::new().filename(&damaged).connect().await.unwrap();
    sqlx::raw_sql(damage).execute(&mut conn).await.unwrap();
    sqlx::Connection::close(conn).await.unwrap();
    damaged
}

#[tokio::test(flavor = "multi_thread")]
async fn check_finds_each_kind_of_damage() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("db.sqlite3");
    assert_eq!(serve_compacted_run(&file).await.terminate(), Some(0));
    for (damage, found) in [
        ("UPDATE episodes SET score = 0.123 WHERE outcome IS NOT NULL", "replays to"),
        ("DELETE FROM action_logs", "but no actions"),
        ("UPDATE task_counters SET episodes = episodes + 1", "counts"),
        (
            "INSERT INTO claim_counters VALUES ('run', 'kessler/survival', 0, 3, 1.5, 0, 0, 0, 0, 0)",
            "counts claims as",
        ),
        ("UPDATE groups SET finished = finished + 1", "finished episodes but has"),
        ("UPDATE compacted_leases SET body = x'0102'", "cannot be read"),
        ("UPDATE curriculum_snapshots SET body = '{}'", "cannot be loaded"),
        ("PRAGMA foreign_keys = OFF; DELETE FROM scenarios", "refers to a missing row of scenarios"),
    ] {
        let damaged = damage_copy(&file, damage).await;
        let checked = db(&damaged, &["check"]);
        assert!(
            checked.status.code() == Some(1) && output_text(&checked).contains(found),
            "{damage}: {}",
            output_text(&checked)
        );
    }
    // Pages that the disk lost: a sample of all used pages but the first, which identifies the file.
    assert_eq!(db(&file, &["vacuum"]).status.code(), Some(0));
    let whole = std::fs::read(&file).unwrap();
    let pages = whole.len() / 4096;
    for page in (1..pages).step_by(pages / 12) {
        let mut bytes = whole.clone();
        bytes[page * 4096..(page + 1) * 4096].fill(0xa5);
        std::fs::write(folder.path().join("torn.sqlite3"), bytes).unwrap();
        let checked = db(&folder.path().join("torn.sqlite3"), &["check"]);
        assert!(
            checked.status.code() == Some(1) && checked.stderr.is_empty(),
            "page {page}: {}",
            output_text(&checked)
        );
    }
    // Files that are no database of Sparring are rejected.
    std::fs::write(folder.path().join("notes.txt"), "x".repeat(5000)).unwrap();
    for (name, why) in [("notes.txt", "is not an SQLite database"), ("nowhere", "does not exist")] {
        let output = db(&folder.path().join(name), &["info"]);
        assert!(
            output.status.code() == Some(2) && output_text(&output).contains(why),
            "{}",
            output_text(&output)
        );
        assert!(!folder.path().join("nowhere").exists(), "reading creates no file");
    }
    read_only_copies_can_be_inspected(&file).await;
}

/// Inspects a copy in a read-only folder, as on a read-only medium.
///
/// Root may write everywhere. As root, the test therefore runs a copy of the binary as the unprivileged user 65534.
async fn read_only_copies_can_be_inspected(file: &Path) {
    let medium = tempfile::tempdir().unwrap();
    let copy = medium.path().join("copy.sqlite3");
    assert_eq!(db(file, &["backup", copy.to_str().unwrap()]).status.code(), Some(0));
    let set = |mode| {
        let mode = std::os::unix::fs::PermissionsExt::from_mode(mode);
        std::fs::set_permissions(medium.path(), mode).unwrap();
    };
    std::fs::set_permissions(&copy, std::os::unix::fs::PermissionsExt::from_mode(0o444)).unwrap();
    let (root, program) =
        (std::fs::metadata(medium.path()).unwrap().uid() == 0, medium.path().join("sparring"));
    if root {
        std::fs::copy(sparring_binary(), &program).unwrap();
    }
    set(0o555);
    for subcommand in ["info", "check"] {
        let mut command = Command::new(if root { &program } else { sparring_binary() });
        command.args(["db", subcommand, "--db"]).arg(&copy);
        if root {
            command.uid(65534).gid(65534);
        }
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{subcommand}: {}", output_text(&output));
    }
    set(0o755);
}
