//! A server with workers on NATS: its database is the same with none, one or eight workers, killed or not.

#[cfg(target_os = "linux")]
mod cost;
mod operation;
mod stored_state;

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use serde_json::{Value, json};
use system_tests::nats_server::NatsServer;
use system_tests::{ApiClient, ServerProcess, sparring_binary, wait_until};

use self::stored_state::{StoredState, is_prepared, read_state};

const RUN_SETTINGS: &str = r#"{"id": "run", "seed": 77, "group_size": 2, "target": "mastery", "design": {"designer": "off"},
    "tasks": ["kessler/survival", "kessler/eco_station"]}"#;
const ROUNDS: usize = 12;

/// A `sparring worker` in its own process. Dropping it kills the process.
struct WorkerChild(Child);

impl WorkerChild {
    fn start(nats: &NatsServer, host: &str) -> Self {
        let mut command = Command::new(sparring_binary());
        command.args(["worker", "--nats", &nats.url(), "--concurrency", "1", "--host", host]);
        Self(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the worker starts"))
    }
}

impl Drop for WorkerChild {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A server with its database, its workers, and the NATS server between them.
struct Cluster {
    server: Option<ServerProcess>,
    workers: Vec<WorkerChild>,
    nats: Option<NatsServer>,
    folder: tempfile::TempDir,
}

impl Cluster {
    /// Starts a server with a number of workers; without NATS it does all jobs itself.
    async fn start(nats: Option<NatsServer>, workers: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut cluster = Self { server: None, workers: Vec::new(), nats, folder };
        cluster.start_server();
        for number in 0..workers {
            cluster.add_worker(&format!("host{number}"));
        }
        cluster.wait_for_workers(workers).await;
        cluster
    }

    fn db(&self) -> PathBuf {
        self.folder.path().join("trained.sqlite3")
    }

    fn start_server(&mut self) {
        let url = self.nats.as_ref().map(NatsServer::url);
        let options = match &url {
            Some(url) => {
                vec!["--nats", url, "--nats-min-job", "0", "--nats-patience", "1", "--nats-verify", "0.1"]
            }
            None => Vec::new(),
        };
        self.server = Some(ServerProcess::start_with_options(&self.db(), &options));
    }

    fn add_worker(&mut self, host: &str) {
        self.workers.push(WorkerChild::start(self.nats.as_ref().unwrap(), host));
    }

    fn api(&self) -> ApiClient {
        self.server.as_ref().unwrap().api()
    }

    async fn list(&self) -> Value {
        self.api().get("/v1/workers").await.expect(200)
    }

    async fn wait_for_workers(&self, count: usize) {
        wait_until("the workers join", async || {
            let list = self.list().await;
            let workers = list["workers"].as_array().unwrap();
            workers.iter().filter(|worker| worker["state"] == "active").count() >= count
        })
        .await;
    }

    async fn create_run(&self) {
        let _ = self.api().post("/v1/runs", serde_json::from_str(RUN_SETTINGS).unwrap()).await.expect(201);
    }

    /// Leases eight groups and reports their results; the policy improves after four rounds.
    async fn train_round(&self, number: usize) {
        let api = self.api();
        let lease = api.lease("run", json!({"groups": 8})).await;
        let results = lease.results(if number < 4 { "hold" } else { "heuristic" });
        for half in results.chunks(results.len() / 2 + 1) {
            let answer = api.report("run", half.to_vec()).await;
            assert!(answer["results"].as_array().unwrap().iter().all(|result| result["status"] == "counted"));
        }
    }

    /// Waits for the background work, stops everything, and returns what the server stored.
    async fn finish(mut self) -> StoredState {
        let (api, db) = (self.api(), self.db());
        wait_until("background work ends", async || has_no_critiques(&api).await && is_prepared(&db).await)
            .await;
        self.workers.clear();
        assert_eq!(self.server.take().unwrap().terminate(), Some(0));
        read_state(&db).await
    }
}

async fn metrics(api: &ApiClient) -> String {
    api.get("/metrics").await.expect(200).as_str().unwrap().to_owned()
}

async fn has_no_critiques(api: &ApiClient) -> bool {
    metrics(api).await.contains("sparring_critique_waiting 0\n")
}

/// Trains a run without any fault.
async fn trained(nats: Option<NatsServer>, workers: usize) -> StoredState {
    let cluster = Cluster::start(nats, workers).await;
    cluster.create_run().await;
    for number in 0..ROUNDS {
        cluster.train_round(number).await;
    }
    let done = cluster.list().await["counters"]["done_remotely"].as_u64().unwrap();
    assert!(workers == 0 && done == 0 || done > 20, "workers did {done} jobs");
    cluster.finish().await
}

#[tokio::test(flavor = "multi_thread")]
async fn stored_state_does_not_depend_on_workers() {
    let Some(nats) = NatsServer::start() else { return };
    let alone = trained(None, 0).await;
    assert_eq!(alone.rows("episodes"), 16 * ROUNDS);
    assert!(
        alone.rows("failure_cells") > 5 && alone.rows("brackets") > 5 * ROUNDS,
        "there is enough to compare"
    );
    alone.assert_equal(&trained(Some(nats), 0).await, "without a worker");
    alone.assert_equal(&trained(NatsServer::start(), 1).await, "with one worker");
}

#[tokio::test(flavor = "multi_thread")]
async fn stored_state_does_not_depend_on_kills() {
    let Some(nats) = NatsServer::start() else { return };
    let alone = trained(None, 0).await;
    let mut cluster = Cluster::start(Some(nats), 8).await;
    cluster.create_run().await;
    let mut done = 0;
    for number in 0..ROUNDS {
        // A worker dies while it holds jobs, and another one joins.
        drop(cluster.workers.remove(number % 8));
        cluster.add_worker(&format!("new{number}"));
        if number == 6 {
            let nats = cluster.nats.as_mut().unwrap();
            nats.kill();
            nats.resume();
        }
        if number % 5 == 4 {
            done += cluster.list().await["counters"]["done_remotely"].as_u64().unwrap();
            cluster.server.take().unwrap().kill();
            cluster.start_server();
            cluster.wait_for_workers(1).await;
        }
        cluster.train_round(number).await;
    }
    done += cluster.list().await["counters"]["done_remotely"].as_u64().unwrap();
    assert!(done > 20, "workers did {done} jobs");
    alone.assert_equal(&cluster.finish().await, "with eight workers, killed");
}
