//! A server whose jobs workers do, with the NATS server between them.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use serde_json::Value;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};

use crate::nats_server::NatsServer;
use crate::{ApiClient, ServerProcess, child_group, sparring_binary, wait_until};

/// A `sparring worker` in its own process. Dropping it kills the process.
#[derive(Debug)]
pub struct WorkerProcess(Child);

impl WorkerProcess {
    /// Starts a worker that does one job at a time.
    ///
    /// # Panics
    /// Panics if the process does not start.
    #[must_use]
    pub fn start(nats: &NatsServer, host: &str) -> Self {
        Self::start_with_options(&["--nats", &nats.url(), "--host", host])
    }

    /// Starts a worker with other options, that does one job at a time.
    ///
    /// # Panics
    /// Panics if the process does not start.
    #[must_use]
    pub fn start_with_options(options: &[&str]) -> Self {
        Self::start_with_variables(options, &[])
    }

    /// Starts a worker with options and environment variables, that does one job at a time.
    ///
    /// # Panics
    /// Panics if the process does not start.
    #[must_use]
    pub fn start_with_variables(options: &[&str], variables: &[(&str, &str)]) -> Self {
        let mut command = Command::new(sparring_binary());
        command.args(["worker", "--concurrency", "1"]).args(options).envs(variables.iter().copied());
        child_group::join(&mut command);
        Self(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the worker starts"))
    }

    /// Returns the id of the process.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.0.id()
    }
}

impl Drop for WorkerProcess {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Options of a server that sends every job to workers, takes it back after a second, and verifies a tenth of the results.
#[must_use]
pub fn nats_options(url: &str) -> Vec<String> {
    ["--nats", url, "--nats-min-job", "0", "--nats-patience", "1", "--nats-verify", "0.1"]
        .map(str::to_owned)
        .to_vec()
}

/// A server with its database, its workers, and the NATS server between them.
#[derive(Debug)]
pub struct WorkerCluster {
    /// The server; none while it is down.
    pub server: Option<ServerProcess>,
    /// Workers in the order in which they were added.
    pub workers: Vec<WorkerProcess>,
    /// NATS server; none if the server does all jobs itself.
    pub nats: Option<NatsServer>,
    folder: tempfile::TempDir,
}

impl WorkerCluster {
    /// Starts a server with a number of workers; without NATS it does all jobs itself.
    ///
    /// # Panics
    /// Panics if a process does not start.
    pub async fn start(nats: Option<NatsServer>, workers: usize) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut cluster = Self { server: None, workers: Vec::new(), nats, folder };
        cluster.start_server();
        for number in 0..workers {
            cluster.add_worker(&format!("host{number}"));
        }
        cluster.wait_for_workers(workers).await;
        cluster
    }

    /// Path of the database.
    #[must_use]
    pub fn db(&self) -> PathBuf {
        self.folder.path().join("trained.sqlite3")
    }

    /// Starts the server, again if it was down.
    ///
    /// # Panics
    /// Panics if the server does not start.
    pub fn start_server(&mut self) {
        let options = self.nats.as_ref().map_or_else(Vec::new, |nats| nats_options(&nats.url()));
        let options: Vec<&str> = options.iter().map(String::as_str).collect();
        self.server = Some(ServerProcess::start_with_options(&self.db(), &options));
    }

    /// Starts a worker with a name of its host.
    ///
    /// # Panics
    /// Panics without NATS, or if the worker does not start.
    pub fn add_worker(&mut self, host: &str) {
        self.workers.push(WorkerProcess::start(self.nats.as_ref().expect("a NATS server"), host));
    }

    /// The running server.
    ///
    /// # Panics
    /// Panics while the server is down.
    #[must_use]
    pub fn server(&self) -> &ServerProcess {
        self.server.as_ref().expect("the server runs")
    }

    /// Client of the server.
    #[must_use]
    pub fn api(&self) -> ApiClient {
        self.server().api()
    }

    /// Asks the server for its workers and the counters of their jobs.
    ///
    /// # Panics
    /// Panics if the server does not answer.
    pub async fn list(&self) -> Value {
        self.api().get("/v1/workers").await.expect(200)
    }

    /// Waits until this many workers do jobs.
    pub async fn wait_for_workers(&self, count: usize) {
        wait_until("the workers join", async || {
            let list = self.list().await;
            let workers = list["workers"].as_array().into_iter().flatten();
            workers.filter(|worker| worker["state"] == "active").count() >= count
        })
        .await;
    }

    /// Waits until every proposal has its scenario, and no episode waits for its critique.
    pub async fn wait_for_background_work(&self) {
        wait_until("background work ends", async || {
            self.has_no_critiques().await && is_prepared(&self.db()).await
        })
        .await;
    }

    /// Waits until every proposal has its scenario.
    pub async fn wait_for_scenarios(&self) {
        wait_until("the queue is prepared", async || is_prepared(&self.db()).await).await;
    }

    /// Reads the metrics of the server.
    ///
    /// # Panics
    /// Panics if the server does not answer.
    pub async fn metrics(&self) -> String {
        self.api().get("/metrics").await.expect(200).as_str().unwrap_or_default().to_owned()
    }

    async fn has_no_critiques(&self) -> bool {
        self.metrics().await.contains("sparring_critique_waiting 0\n")
    }
}

/// True if every proposal of a database has its scenario.
///
/// # Panics
/// Panics if the database cannot be read.
pub async fn is_prepared(db: &Path) -> bool {
    let waiting = "SELECT count(*) FROM proposals WHERE scenario IS NULL";
    let mut conn = SqliteConnectOptions::new().filename(db).connect().await.expect("the database opens");
    let waiting = sqlx::query_scalar::<_, i64>(waiting).fetch_one(&mut conn).await.expect("the table exists");
    let _ = conn.close().await;
    waiting == 0
}
