//! Workers on a NATS server with TLS and one key for each role, by the configuration that deployments use.

use std::sync::{Arc, Mutex};

use system_tests::worker_cluster::WorkerProcess;
use system_tests::{ServerProcess, wait_until};

use super::secure_nats::{SecureNats, as_strs};
use super::servers::{OptionServer, done_remotely, wait_for_kind};
use super::*;
use crate::design::{create, request_design};

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

    let forged = ["results.server.critique.me", "jobs.audit.server", "control.other"];
    assert_denied(&nats, "REPLAY_WORKER", forged).await;
    // The server ignores what is no heartbeat, and goes on.
    assert_eq!(workers().await["workers"].as_array().unwrap().len(), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_key_for_designs_can_do_nothing_else() {
    let Some(nats) = SecureNats::start() else { return };
    let server = OptionServer::start(&nats.options("SERVER"));
    let options = [nats.options("DESIGN_WORKER"), ["--jobs", "design"].map(str::to_owned).to_vec()].concat();
    let _worker = WorkerProcess::start_with_options(&as_strs(&options));
    let api = server.api();
    create(&api, json!({"designer": "off"})).await;
    wait_for_kind(&api, "design_procedural").await;
    let request = request_design(&api, json!({"count": 1, "designer": "procedural"})).await;
    assert_eq!((&request["state"], &request["admitted"]), (&json!("done"), &json!(1)), "{request}");
    assert_eq!(done_remotely(&api).await, 1);
    let forged = ["results.server.audit.me", "jobs.design_llm.server", "results.server.rollout_chat.me"];
    assert_denied(&nats, "DESIGN_WORKER", forged).await;
}

/// Checks that a role may neither publish on these subjects nor read jobs, and that it may publish heartbeats.
async fn assert_denied(nats: &SecureNats, role: &str, subjects: [&str; 3]) {
    let errors = Arc::new(Mutex::new(Vec::new()));
    let client = nats.connect(role, &errors).await;
    for subject in subjects {
        client.publish(format!("sparring.default.{subject}"), "forged".into()).await.unwrap();
    }
    let _jobs = client.subscribe("sparring.default.jobs.>").await.unwrap();
    client.publish("sparring.default.workers.me", "not a heartbeat".into()).await.unwrap();
    client.flush().await.unwrap();
    wait_until("the server has denied all", async || errors.lock().unwrap().len() >= 4).await;
    let denied = errors.lock().unwrap().clone();
    assert!(denied.iter().all(|error| error.to_lowercase().contains("permissions violation")), "{denied:?}");
    assert_eq!(denied.len(), 4, "{denied:?}");
}
