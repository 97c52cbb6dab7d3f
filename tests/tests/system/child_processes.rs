//! A test or a benchmark that is killed leaves no process behind.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use system_tests::nats_server::NatsServer;
use system_tests::worker_cluster::WorkerProcess;
use system_tests::{ServerProcess, wait_until};

/// File to which a second run of the test writes the ids of the processes that it starts.
const IDS_FILE: &str = "CHILD_PROCESSES_FILE";

/// The test runs itself once more, in a process that it kills.
#[tokio::test]
async fn a_killed_test_leaves_no_processes() {
    if let Some(file) = std::env::var_os(IDS_FILE) {
        return start_processes_and_wait(Path::new(&file));
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("ids.json");
    let mut test = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "child_processes::a_killed_test_leaves_no_processes"])
        .env(IDS_FILE, &file)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    wait_until("the processes run", async || file.exists()).await;
    let ids: Vec<u32> = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    assert!(!ids.is_empty() && ids.iter().all(|id| is_running(*id)), "{ids:?}");
    test.kill().unwrap();
    test.wait().unwrap();
    wait_until("no process is left", async || !ids.iter().any(|id| is_running(*id))).await;
}

/// Starts a server, NATS and a worker, writes their ids to the file, and waits to be killed.
fn start_processes_and_wait(file: &Path) {
    let server = ServerProcess::start(&file.with_file_name("db.sqlite3"));
    let mut ids = vec![server.pid()];
    let nats = NatsServer::start();
    let worker = nats.as_ref().map(|nats| WorkerProcess::start(nats, "host"));
    ids.extend(worker.iter().map(WorkerProcess::pid).chain(nats.iter().filter_map(NatsServer::pid)));
    let unfinished = file.with_extension("unfinished");
    std::fs::write(&unfinished, serde_json::to_string(&ids).unwrap()).unwrap();
    std::fs::rename(&unfinished, file).unwrap();
    std::thread::sleep(Duration::from_secs(600));
}

/// True if a process runs. One that has ended may wait for the init process.
fn is_running(id: u32) -> bool {
    let state = std::fs::read_to_string(format!("/proc/{id}/stat")).unwrap_or_default();
    state.rsplit(") ").next().is_some_and(|rest| !rest.is_empty() && !rest.starts_with(['Z', 'X']))
}
