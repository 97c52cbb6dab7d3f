//! Files of the database are damaged, truncated or removed while the server runs: it stops to acknowledge, says why and which backup
//! is the newest, and serves what can still be read.

use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::{Value, json};
use system_tests::{ApiClient, ServerProcess, sparring_binary, wait_for, wait_until};

use super::{report, start_run, stored_episodes};

const READS: [&str; 7] = [
    "/v1/runs",
    "/v1/runs/run",
    "/v1/runs/run/mastery",
    "/v1/runs/run/episodes?limit=500",
    "/v1/runs/run/leases",
    "/v1/runs/run/level_moves",
    "/v1/audit",
];

fn path_of(db: &Path, ending: &str) -> PathBuf {
    format!("{}{ending}", db.display()).into()
}

fn truncate(path: &Path, bytes: u64) {
    std::fs::File::options().write(true).open(path).unwrap().set_len(bytes).unwrap();
}

/// Overwrites a part of a file.
fn overwrite(path: &Path, from: u64, to: u64) {
    let file = std::fs::File::options().write(true).open(path).unwrap();
    file.write_all_at(&vec![0xa5; usize::try_from(to - from).unwrap()], from).unwrap();
}

fn sparring(args: &[&str], db: &Path) -> Output {
    Command::new(sparring_binary()).args(args).arg("--db").arg(db).output().unwrap()
}

/// Server with four reported episodes and a backup.
struct DamagedServer {
    process: ServerProcess,
    folder: tempfile::TempDir,
    results: Vec<Value>,
}

impl DamagedServer {
    async fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let process = ServerProcess::start(&folder.path().join("db.sqlite3"));
        let (results, _) = start_run(&process.api()).await;
        let _ = report(&process.api(), &results[..4]).await.expect(200);
        let server = Self { process, folder, results };
        let backup = sparring(&["db", "backup", server.backup().to_str().unwrap()], &server.db());
        assert_eq!(backup.status.code(), Some(0), "{backup:?}");
        wait_until("the log is copied into the database", async || {
            std::fs::metadata(server.db()).unwrap().len() > 50 * 4096
        })
        .await;
        server
    }

    fn db(&self) -> PathBuf {
        self.folder.path().join("db.sqlite3")
    }

    fn backup(&self) -> PathBuf {
        self.folder.path().join("monday.sqlite3")
    }

    /// Sends changes and reads until the server is not ready, and returns the reason. No response is an internal error. Before each
    /// round the damage is done again: a log that is truncated just after it was copied into the database has lost nothing.
    async fn wait_until_not_ready(&self, damage: impl Fn(&Path)) -> String {
        let api = self.process.api();
        wait_for("the server notices the damage", async || {
            damage(&self.db());
            self.assert_no_internal_error(&api).await;
            let ready = api.get("/readyz").await;
            (ready.status == 503).then(|| ready.body["detail"].as_str().unwrap().to_owned())
        })
        .await
    }

    async fn assert_no_internal_error(&self, api: &ApiClient) {
        let lease = api.post("/v1/runs/run/leases", json!({"groups": 1})).await;
        assert!(matches!(lease.status, 201 | 503), "{}", lease.body);
        for path in READS {
            let response = api.get(path).await;
            assert!(matches!(response.status, 200 | 503), "{path}: {}", response.body);
        }
    }

    /// Checks that the server acknowledges nothing, and stays so.
    async fn assert_stopped(&self) {
        let api = self.process.api();
        let rejected = report(&api, &self.results[4..]).await;
        assert_eq!(rejected.status, 503, "{}", rejected.body);
        self.assert_no_internal_error(&api).await;
        assert_eq!(api.get("/livez").await.status, 200);
        assert_eq!(api.get("/readyz").await.status, 503);
        let metrics = api.get("/metrics").await;
        assert!(metrics.body.as_str().unwrap().contains("sparring_writable 0"));
    }
}

/// Damages the files of a running server in one way, and checks its reaction, the next start, and the restored backup.
async fn damage_stops_server(damage: impl Fn(&Path)) {
    let server = DamagedServer::start().await;
    let reason = server.wait_until_not_ready(damage).await;
    assert!(reason.contains("is damaged"), "{reason}");
    assert!(reason.contains("The newest backup is monday.sqlite3 of 20"), "{reason}");
    server.assert_stopped().await;
    let (db, backup) = (server.db(), server.backup());
    let DamagedServer { process, folder, results } = server;
    process.kill();
    std::fs::copy(&backup, &db).unwrap();
    for ending in ["-wal", "-shm"] {
        let _ = std::fs::remove_file(path_of(&db, ending));
    }
    let process = ServerProcess::start(&db);
    let api = process.api();
    assert_eq!(stored_episodes(&api).await, 4, "the backup has all episodes from before it");
    let receipts = report(&api, &results).await.expect(200);
    assert_eq!(receipts["results"].as_array().unwrap().len(), 8);
    assert_eq!(process.terminate(), Some(0));
    let check = sparring(&["db", "check"], &db);
    assert_eq!(check.status.code(), Some(0), "{check:?}");
    drop(folder);
}

#[tokio::test(flavor = "multi_thread")]
async fn truncated_database_stops_the_server() {
    damage_stops_server(|db| truncate(db, 4096)).await;
    damage_stops_server(|db| truncate(db, 0)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn truncated_log_stops_the_server() {
    damage_stops_server(|db| truncate(&path_of(db, "-wal"), 0)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn overwritten_pages_stop_the_server() {
    damage_stops_server(|db| overwrite(db, 4096, std::fs::metadata(db).unwrap().len())).await;
    damage_stops_server(|db| overwrite(db, 0, std::fs::metadata(db).unwrap().len())).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn removed_files_stop_the_server() {
    for ending in ["", "-wal", "-shm"] {
        let server = DamagedServer::start().await;
        std::fs::remove_file(path_of(&server.db(), ending)).unwrap();
        let reason = server.wait_until_not_ready(|_| ()).await;
        assert!(reason.contains("was removed or replaced"), "{ending}: {reason}");
        server.assert_stopped().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn damaged_database_does_not_start_and_the_backup_is_named() {
    let DamagedServer { process, folder, .. } = DamagedServer::start().await;
    assert_eq!(process.terminate(), Some(0));
    let db = folder.path().join("db.sqlite3");
    truncate(&db, 8 * 4096);
    let backup = folder.path().join("monday.sqlite3").canonicalize().unwrap().display().to_string();
    for command in [["serve", "--bind", "127.0.0.1:0"].as_slice(), &["db", "info"]] {
        let output = sparring(command, &db);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.contains("is corrupt") && text.contains(&backup), "{text}");
    }
}
