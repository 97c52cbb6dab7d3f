//! A full disk, one that fails or is slow, a database that somebody holds, a clock that jumps: a clear state, nothing lost, and
//! it goes on by itself when the cause goes. A real server, with the system's calls made to fail (fixtures/faults.c).

#![cfg(target_os = "linux")]
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use sqlx::ConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;
use system_tests::{Answer, Api, Process, binary, result};

const ENOSPC: i64 = 28;
const EIO: i64 = 5;
const DAY_MS: i64 = 86_400_000;

/// The library that makes calls fail.
fn library() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/faults.c");
        let built = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("faults-{}.so", std::process::id()));
        let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
        let done = Command::new(compiler)
            .args(["-shared", "-fPIC", "-O1", "-Wall", "-Wextra", "-Werror", "-o"])
            .args([&built, &source])
            .arg("-ldl")
            .status();
        assert!(done.is_ok_and(|done| done.success()), "a C compiler is needed, as for SQLite");
        built
    })
}

/// A server whose disk and clock do as they are told.
struct Faulty {
    process: Process,
    folder: tempfile::TempDir,
    faults: std::fs::File,
}

/// What may go wrong, as faults.c has it.
#[derive(Clone, Copy)]
enum Fault {
    Write = 0,
    Sync = 1,
    SlowSyncMs = 2,
    ClockMs = 3,
}

impl Faulty {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("data")).unwrap();
        let control = folder.path().join("faults");
        std::fs::write(&control, [0; 32]).unwrap();
        let faults = std::fs::File::options().write(true).open(&control).unwrap();
        let mut command = Command::new(binary());
        command.env("LD_PRELOAD", library()).env("FAULTS", &control);
        // As the system names it: a temporary folder may be reached by a link.
        command.env("FAULTS_UNDER", folder.path().canonicalize().unwrap().join("data"));
        command.args(["serve", "--bind", "127.0.0.1:0", "--db"]).arg(folder.path().join("data/db.sqlite3"));
        let process = Process::run(command, Stdio::null());
        Self { process, folder, faults }
    }

    fn api(&self) -> Api {
        self.process.api()
    }

    fn db(&self) -> PathBuf {
        self.folder.path().join("data/db.sqlite3")
    }

    fn set(&self, fault: Fault, value: i64) {
        self.faults.write_all_at(&value.to_ne_bytes(), fault as u64 * 8).unwrap();
    }

    /// Stops it, and looks through what it leaves.
    async fn whole(self) {
        let code = tokio::task::spawn_blocking(move || {
            let (db, Self { process, folder, .. }) = (self.db(), self);
            assert_eq!(process.terminate(), Some(0));
            let check = Command::new(binary()).args(["db", "check", "--db"]).arg(db).output().unwrap();
            drop(folder);
            (check.status.code(), String::from_utf8(check.stdout).unwrap())
        });
        let (code, told) = code.await.unwrap();
        assert_eq!(code, Some(0), "{told}");
    }
}

async fn begin(api: &Api) -> (Vec<Value>, Value) {
    let wish = json!({"id": "run", "seed": 3, "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let lease = api.lease("run", json!({"groups": 8})).await;
    let results = lease.episodes().iter().map(|(id, scenario)| result(id, scenario, "hold")).collect();
    (results, lease.0)
}

async fn report(api: &Api, results: &[Value]) -> Answer {
    api.post("/v1/runs/run/results", json!({"results": results})).await
}

async fn finished(api: &Api) -> usize {
    api.get("/v1/runs/run/episodes?limit=500").await.expect(200)["episodes"].as_array().unwrap().len()
}

/// Waits until it is ready again; how long that took.
async fn ready(api: &Api) -> Duration {
    let begun = Instant::now();
    while api.get("/readyz").await.status != 200 {
        assert!(begun.elapsed() < Duration::from_secs(20), "it does not go on by itself");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    begun.elapsed()
}

/// Nothing can be stored: that is said, with why; what is stored can be read; and it goes on when the cause is gone.
async fn goes_on_after(fault: Fault, number: i64, why: &str) {
    let server = Faulty::start();
    let api = server.api();
    let (results, _) = begin(&api).await;
    let _ = report(&api, &results[..3]).await.expect(200);
    server.set(fault, number);
    for _ in 0..3 {
        let refused = report(&api, &results[3..6]).await;
        assert_eq!(refused.status, 503, "{}", refused.body);
        assert_eq!(refused.kind, "application/problem+json");
        assert!(refused.body["detail"].as_str().unwrap().contains(why), "{}", refused.body);
        assert!(refused.retry_after.is_some());
        let lease = api.post("/v1/runs/run/leases", json!({"groups": 1})).await;
        assert_eq!(lease.status, 503, "{}", lease.body);
    }
    let ready_now = api.get("/readyz").await;
    assert_eq!(ready_now.status, 503);
    assert!(ready_now.body["detail"].as_str().unwrap().contains(why), "{}", ready_now.body);
    assert_eq!(api.get("/livez").await.status, 200);
    assert_eq!(finished(&api).await, 3, "what was acknowledged is there, and nothing else");
    let counted = api.get("/metrics").await;
    let counted = counted.body.as_str().unwrap();
    assert!(counted.contains("sparring_writable 0"), "{counted}");
    server.set(fault, 0);
    let _ = ready(&api).await;
    let told = report(&api, &results).await.expect(200);
    let statuses: Vec<&str> =
        told["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect();
    assert_eq!(
        statuses,
        ["duplicate", "duplicate", "duplicate", "counted", "counted", "counted", "counted", "counted"]
    );
    let _ = api.lease("run", json!({"groups": 2})).await;
    assert_eq!(finished(&api).await, 8);
    server.whole().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_disk() {
    goes_on_after(Fault::Write, ENOSPC, "the disk is full").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_disk_that_fails() {
    goes_on_after(Fault::Write, EIO, "the disk fails").await;
    goes_on_after(Fault::Sync, EIO, "the disk fails").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_slow_disk() {
    let server = Faulty::start();
    let api = server.api();
    let (results, _) = begin(&api).await;
    server.set(Fault::SlowSyncMs, 400);
    // Forty reports share commits, whatever one takes.
    let begun = Instant::now();
    let told = futures_util::future::join_all((0..40).map(|at| {
        let (api, one) = (api.clone(), vec![results[at % 8].clone()]);
        async move { report(&api, &one).await.expect(200) }
    }))
    .await;
    assert!(begun.elapsed() < Duration::from_secs(12), "{:?} for 40 reports", begun.elapsed());
    let counted = told.iter().filter(|told| told["results"][0]["status"] == "counted").count();
    assert_eq!((counted, finished(&api).await), (8, 8));
    assert_eq!(api.get("/readyz").await.status, 200, "slow is not broken");
    server.set(Fault::SlowSyncMs, 0);
    server.whole().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_database_that_somebody_holds() {
    let server = Faulty::start();
    let api = server.api();
    let (results, _) = begin(&api).await;
    let mut other = SqliteConnectOptions::new().filename(server.db()).connect().await.unwrap();
    sqlx::query("BEGIN IMMEDIATE").execute(&mut other).await.unwrap();
    let refused = report(&api, &results[..2]).await;
    assert_eq!(refused.status, 503, "{}", refused.body);
    assert!(
        refused.body["detail"].as_str().unwrap().contains("another process holds the database"),
        "{}",
        refused.body
    );
    assert!(api.get("/readyz").await.body["detail"].as_str().unwrap().contains("another process holds"));
    assert_eq!(finished(&api).await, 0, "it can be read all the while");
    sqlx::query("ROLLBACK").execute(&mut other).await.unwrap();
    drop(other);
    let _ = ready(&api).await;
    let told = report(&api, &results).await.expect(200);
    assert!(told["results"].as_array().unwrap().iter().all(|r| r["status"] == "counted"), "{told}");
    server.whole().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_clock_that_jumps() {
    for by in [DAY_MS, -DAY_MS] {
        let server = Faulty::start();
        let api = server.api();
        let (results, lease) = begin(&api).await;
        let expires = |lease: &Value| {
            lease["expires_at"].as_str().unwrap().parse::<jiff::Timestamp>().unwrap().as_second()
        };
        let before = expires(&lease);
        server.set(Fault::ClockMs, by);
        tokio::time::sleep(Duration::from_millis(2500)).await;
        let id = lease["lease"].as_str().unwrap();
        let now = api.get(&format!("/v1/runs/run/leases/{id}")).await.expect(200);
        assert_eq!(now["status"], "active", "nobody's lease ends by that");
        let moved = expires(&now) - before;
        assert!((moved - by / 1000).abs() <= 3, "it holds as long as it would have: {moved} s");
        let told = report(&api, &results).await.expect(200);
        assert!(told["results"].as_array().unwrap().iter().all(|r| r["status"] == "counted"), "{told}");
        let other = api.lease("run", json!({"groups": 1, "ttl_s": 1})).await;
        tokio::time::sleep(Duration::from_millis(2500)).await;
        let over = api.get(&format!("/v1/runs/run/leases/{}", other.id())).await.expect(200);
        assert_eq!(over["status"], "expired", "time goes on");
        server.whole().await;
    }
}
