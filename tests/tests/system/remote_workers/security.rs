//! Workers on a NATS server with TLS and one key for each role, by the configuration that deployments use.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use nkeys::KeyPair;
use system_tests::worker_cluster::WorkerProcess;
use system_tests::{ServerProcess, TlsFiles, wait_until};

use super::*;

/// Configuration of a NATS server with keys.
const CONFIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../deploy/nats.conf");

/// NATS server with TLS, and files with the seeds of the keys of its users.
struct SecureNats {
    server: NatsServer,
    tls: TlsFiles,
    folder: tempfile::TempDir,
}

impl SecureNats {
    fn start() -> Option<Self> {
        let (tls, folder) = (TlsFiles::create(), tempfile::tempdir().unwrap());
        let path = |name: &str| tls.path(name).display().to_string();
        let mut variables =
            vec![("NATS_CERT".to_owned(), path("cert.pem")), ("NATS_KEY".to_owned(), path("key.pem"))];
        for user in ["SERVER", "REPLAY_WORKER", "WORKER"] {
            let key = KeyPair::new_user();
            std::fs::write(folder.path().join(user), key.seed().unwrap()).unwrap();
            variables.push((format!("{user}_KEY"), key.public_key()));
        }
        let server = NatsServer::start_with(Some(PathBuf::from(CONFIG)), variables)?;
        Some(Self { server, tls, folder })
    }

    fn seed_file(&self, user: &str) -> PathBuf {
        self.folder.path().join(user)
    }

    /// Options of `sparring` for a user.
    fn options(&self, user: &str) -> Vec<String> {
        let text = |path: &Path| path.display().to_string();
        let (ca, seed) = (text(&self.tls.path("ca.pem")), text(&self.seed_file(user)));
        ["--nats", &self.server.tls_url(), "--nats-ca", &ca, "--nats-creds", &seed]
            .map(str::to_owned)
            .to_vec()
    }

    /// Connects as a user. Errors that the server reports are added to `errors`.
    async fn connect(&self, user: &str, errors: &Arc<Mutex<Vec<String>>>) -> async_nats::Client {
        let seed = std::fs::read_to_string(self.seed_file(user)).unwrap();
        let errors = Arc::clone(errors);
        let options = async_nats::ConnectOptions::with_nkey(seed)
            .add_root_certificates(self.tls.path("ca.pem"))
            .event_callback(move |event| {
                let errors = Arc::clone(&errors);
                async move {
                    if let async_nats::Event::ServerError(error) = event {
                        errors.lock().unwrap().push(error.to_string());
                    }
                }
            });
        options.connect(self.server.tls_url()).await.unwrap()
    }
}

fn as_strs(options: &[String]) -> Vec<&str> {
    options.iter().map(String::as_str).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_key_for_replays_can_do_nothing_else() {
    let Some(nats) = SecureNats::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut options = nats.options("SERVER");
    options.extend(["--nats-min-job", "0"].map(str::to_owned));
    let server = ServerProcess::start_with_options(&folder.path().join("db.sqlite3"), &as_strs(&options));
    let mut options = nats.options("REPLAY_WORKER");
    options.extend(["--jobs", "audit"].map(str::to_owned));
    let _worker = WorkerProcess::start_with_options(&as_strs(&options));
    let api = server.api();
    let workers = async || api.get("/v1/workers").await.expect(200);
    wait_until("the worker joins", async || workers().await["workers"][0]["state"] == "active").await;
    let _ = api.post("/v1/runs", serde_json::from_str(RUN_SETTINGS).unwrap()).await.expect(201);
    let lease = api.lease("run", json!({"groups": 8})).await;
    let _ = api.report("run", lease.results("hold")).await;
    let counters = workers().await["counters"].clone();
    assert!(counters["done_remotely"].as_u64() > Some(0), "{counters}");

    let errors = Arc::new(Mutex::new(Vec::new()));
    let client = nats.connect("REPLAY_WORKER", &errors).await;
    for subject in ["results.server.critique.me", "jobs.audit.server", "control.other"] {
        client.publish(format!("sparring.default.{subject}"), "forged".into()).await.unwrap();
    }
    let _jobs = client.subscribe("sparring.default.jobs.>").await.unwrap();
    client.publish("sparring.default.workers.me", "not a heartbeat".into()).await.unwrap();
    client.flush().await.unwrap();
    wait_until("the server has denied all", async || errors.lock().unwrap().len() >= 4).await;
    let denied = errors.lock().unwrap().clone();
    assert!(denied.iter().all(|error| error.to_lowercase().contains("permissions violation")), "{denied:?}");
    assert_eq!(denied.len(), 4, "{denied:?}");
    // The server ignores what is no heartbeat, and goes on.
    assert_eq!(workers().await["workers"].as_array().unwrap().len(), 1);
}
