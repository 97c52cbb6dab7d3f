//! `sparring db`: beside a running server, on what is whole and on what is not.

use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};
use sqlx::ConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;
use system_tests::{Process, binary, result};

fn db(file: &Path, args: &[&str]) -> Output {
    Command::new(binary()).args(["db"]).args(args).arg("--db").arg(file).output().unwrap()
}

fn said(out: &Output) -> String {
    String::from_utf8([out.stdout.clone(), out.stderr.clone()].concat()).unwrap()
}

/// A server with a run of some episodes; of them some are folded.
async fn served(file: &Path) -> Process {
    let server = Process::start(file);
    let api = server.api();
    let wish = json!({"id": "run", "seed": 5, "placement": false, "tasks": ["kessler/survival"], "retention": {"episodes": 4},
                      "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    for _ in 0..6 {
        let lease = api.lease("run", json!({"groups": 4})).await;
        let results = lease.episodes().iter().map(|(id, s)| result(id, s, "heuristic")).collect();
        let _ = api.report("run", results).await;
    }
    for _ in 0..100 {
        let listed = api.get("/v1/runs/run/episodes?limit=500").await.expect(200);
        if listed["episodes"].as_array().unwrap().iter().any(|episode| episode["replay"] == "expired") {
            return server;
        }
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    }
    panic!("nothing was folded");
}

#[tokio::test(flavor = "multi_thread")]
async fn it_is_looked_at_copied_and_written_out_while_it_is_served() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("db.sqlite3");
    let server = served(&file).await;
    let (copy, lines) = (folder.path().join("copy.sqlite3"), folder.path().join("lines.ndjson"));

    let info: Value = serde_json::from_slice(&db(&file, &["info", "--format", "json"]).stdout).unwrap();
    let run = &info["runs"][0];
    assert_eq!(run["whole"].as_i64().unwrap() + run["folded"].as_i64().unwrap(), 24, "{info}");
    assert!(run["folded"].as_i64().unwrap() > 0 && info["bytes"].as_i64().unwrap() > 0);
    assert!(said(&db(&file, &["info"])).contains("table, with its indexes"));
    let checked = db(&file, &["check"]);
    assert_eq!(checked.status.code(), Some(0), "{}", said(&checked));

    assert_eq!(db(&file, &["backup", copy.to_str().unwrap()]).status.code(), Some(0));
    let again = db(&file, &["backup", copy.to_str().unwrap()]);
    assert!(again.status.code() == Some(2) && said(&again).contains("exists already"), "{}", said(&again));
    let nowhere = db(&file, &["backup", "/nowhere/copy.sqlite3"]);
    assert!(
        nowhere.status.code() == Some(2) && said(&nowhere).contains("no copy was made"),
        "{}",
        said(&nowhere)
    );

    let out = db(&file, &["export", "--run", "run", "--actions", "--out", lines.to_str().unwrap()]);
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    let text = std::fs::read_to_string(&lines).unwrap();
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!((&lines[0]["kind"], &lines[0]["run"]), (&json!("run"), &json!("run")));
    let episodes: Vec<&Value> = lines.iter().filter(|line| line["kind"] == "episode").collect();
    assert_eq!(episodes.len(), 24);
    for episode in &episodes {
        let whole = episode["replay"] == "available";
        assert!(
            episode["score"].is_f64()
                && episode["scenario"].is_object() == whole
                && episode["actions"].is_array() == whole
        );
    }
    let piped = db(&file, &["export"]).stdout;
    assert_eq!(String::from_utf8(piped).unwrap().lines().count(), lines.len());
    let unknown = db(&file, &["export", "--run", "nobody"]);
    assert!(unknown.status.code() == Some(2) && said(&unknown).contains("there is no run \"nobody\""));

    let vacuum = db(&file, &["vacuum"]);
    assert!(
        vacuum.status.code() == Some(2) && said(&vacuum).contains("stop the other server"),
        "{}",
        said(&vacuum)
    );
    assert_eq!(server.terminate(), Some(0));
    let vacuum = db(&file, &["vacuum"]);
    assert!(vacuum.status.code() == Some(0) && said(&vacuum).contains("before it had"), "{}", said(&vacuum));
    // The copy goes on by itself.
    assert_eq!(db(&copy, &["check"]).status.code(), Some(0));
    let server = Process::start(&copy);
    let episodes = server.api().get("/v1/runs/run/episodes?limit=500").await.expect(200);
    assert_eq!(episodes["episodes"].as_array().unwrap().len(), 24);
    let _ = server.api().lease("run", json!({"groups": 2})).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_wrong_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("db.sqlite3");
    assert_eq!(served(&file).await.terminate(), Some(0));
    for (harm, found) in [
        ("UPDATE episodes SET score = 0.123 WHERE flown IS NOT NULL", "replays to"),
        ("DELETE FROM action_logs", "has no actions"),
        ("UPDATE task_sums SET episodes = episodes + 1", "sums up"),
        (
            "INSERT INTO claimed_sums VALUES ('run', 'kessler/survival', 0, 3, 1.5, 0, 0, 0, 0, 0)",
            "sums up columns as",
        ),
        ("UPDATE groups SET finished = finished + 1", "finished episodes, and has"),
        ("UPDATE folds SET body = x'0102'", "cannot be read"),
        ("UPDATE curriculum_snapshots SET body = '{}'", "cannot be brought back"),
        ("PRAGMA foreign_keys = OFF; DELETE FROM scenarios", "refers to a row of scenarios"),
    ] {
        let harmed = folder.path().join("harmed.sqlite3");
        let _ = std::fs::remove_file(&harmed);
        std::fs::copy(&file, &harmed).unwrap();
        let mut conn = SqliteConnectOptions::new().filename(&harmed).connect().await.unwrap();
        sqlx::raw_sql(harm).execute(&mut conn).await.unwrap();
        sqlx::Connection::close(conn).await.unwrap();
        let checked = db(&harmed, &["check"]);
        assert!(
            checked.status.code() == Some(1) && said(&checked).contains(found),
            "{harm}: {}",
            said(&checked)
        );
    }
    // Pages that the disk lost: but for the first, which says what it is, any that is used.
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
            said(&checked)
        );
    }
    // What is none of ours is told from what is.
    std::fs::write(folder.path().join("notes.txt"), "x".repeat(5000)).unwrap();
    for (name, why) in [("notes.txt", "is not an SQLite database"), ("nowhere", "cannot be opened")] {
        let told = db(&folder.path().join(name), &["info"]);
        assert!(told.status.code() == Some(2) && said(&told).contains(why), "{}", said(&told));
        assert!(!folder.path().join("nowhere").exists(), "looking makes nothing");
    }
    copies_are_looked_at_where_nothing_can_be_written(&file).await;
}

/// A copy in a folder that is read-only, as on a medium that is. Root may write everywhere: then nobody looks, by a program where
/// nobody can reach it.
async fn copies_are_looked_at_where_nothing_can_be_written(file: &Path) {
    let place = tempfile::tempdir().unwrap();
    let copy = place.path().join("copy.sqlite3");
    assert_eq!(db(file, &["backup", copy.to_str().unwrap()]).status.code(), Some(0));
    let set = |mode| {
        let mode = std::os::unix::fs::PermissionsExt::from_mode(mode);
        std::fs::set_permissions(place.path(), mode).unwrap();
    };
    std::fs::set_permissions(&copy, std::os::unix::fs::PermissionsExt::from_mode(0o444)).unwrap();
    let (root, program) =
        (std::fs::metadata(place.path()).unwrap().uid() == 0, place.path().join("sparring"));
    if root {
        std::fs::copy(binary(), &program).unwrap();
    }
    set(0o555);
    for what in ["info", "check"] {
        let mut command = Command::new(if root { &program } else { binary() });
        command.args(["db", what, "--db"]).arg(&copy);
        if root {
            command.uid(65534).gid(65534);
        }
        let told = command.output().unwrap();
        assert_eq!(told.status.code(), Some(0), "{what}: {}", said(&told));
    }
    set(0o755);
}
