//! A server with workers on NATS: its database is the same with none, one or eight workers, killed or not.

mod designs;
mod operation;
mod outage;
mod rollouts;
pub(crate) mod secure_nats;
mod security;
mod servers;
mod stored_state;
mod wrong_layouts;
mod wrong_settings;

use serde_json::json;
use system_tests::is_long_test;
use system_tests::nats_server::NatsServer;
use system_tests::worker_cluster::WorkerCluster;

use self::stored_state::{StoredState, read_state};

const RUN_SETTINGS: &str = r#"{"id": "run", "seed": 77, "group_size": 2, "target": "mastery", "design": {"designer": "off"},
    "tasks": ["kessler/survival", "kessler/eco_station"]}"#;
const ROUNDS: usize = 12;
/// Answer of a language model that designs: two layouts that the gate admits.
const LAYOUTS: &str = r#"{"layouts": [
    {"name": "ahead", "aim": {"mode": "collision", "bearing_deg": 90}, "frame": "radial_in_track", "encounters":
        [{"kind": "threat", "satellite": 0, "step": 8, "bearing_deg": 90, "relative_speed": 40, "miss_distance": 19}]},
    {"name": "behind", "aim": {"mode": "collision", "bearing_deg": 270}, "frame": "radial_in_track", "encounters":
        [{"kind": "threat", "satellite": 0, "step": 9, "bearing_deg": 270, "relative_speed": 40, "miss_distance": 19}]}
]}"#;

/// Creates the run of all tests.
async fn create_run(cluster: &WorkerCluster) {
    let _ = cluster.api().post("/v1/runs", serde_json::from_str(RUN_SETTINGS).unwrap()).await.expect(201);
}

/// Leases eight groups and reports their results; the policy improves after four rounds.
async fn train_round(cluster: &WorkerCluster, number: usize) {
    let api = cluster.api();
    let lease = api.lease("run", json!({"groups": 8})).await;
    let results = lease.results(if number < 4 { "hold" } else { "heuristic" });
    for half in results.chunks(results.len() / 2 + 1) {
        let answer = api.report("run", half.to_vec()).await;
        assert!(answer["results"].as_array().unwrap().iter().all(|result| result["status"] == "counted"));
    }
}

/// Waits for the background work, stops everything, and returns the tables of the database.
async fn finish(mut cluster: WorkerCluster) -> StoredState {
    cluster.wait_for_background_work().await;
    cluster.workers.clear();
    assert_eq!(cluster.server.take().unwrap().terminate(), Some(0));
    read_state(&cluster.db()).await
}

/// Trains a run without any fault.
async fn trained(nats: Option<NatsServer>, workers: usize) -> StoredState {
    let cluster = WorkerCluster::start(nats, workers).await;
    create_run(&cluster).await;
    for number in 0..ROUNDS {
        train_round(&cluster, number).await;
    }
    let done = cluster.list().await["counters"]["done_remotely"].as_u64().unwrap();
    assert!(workers == 0 && done == 0 || done > 20, "workers did {done} jobs");
    finish(cluster).await
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
    if is_long_test() {
        alone.assert_equal(&trained(NatsServer::start(), 8).await, "with eight workers");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn stored_state_does_not_depend_on_kills() {
    let Some(nats) = NatsServer::start() else { return };
    let alone = trained(None, 0).await;
    alone.assert_equal(&trained_with_kills(nats, 8).await, "with eight workers, killed");
    if is_long_test() {
        let nats = NatsServer::start().unwrap();
        alone.assert_equal(&trained_with_kills(nats, 1).await, "with one worker, killed");
    }
}

/// Trains a run while workers, the server and NATS are killed.
async fn trained_with_kills(nats: NatsServer, workers: usize) -> StoredState {
    let mut cluster = WorkerCluster::start(Some(nats), workers).await;
    create_run(&cluster).await;
    let mut done = 0;
    for number in 0..ROUNDS {
        // A worker dies while it holds jobs, and another one joins.
        drop(cluster.workers.remove(number % workers));
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
        train_round(&cluster, number).await;
    }
    done += cluster.list().await["counters"]["done_remotely"].as_u64().unwrap();
    assert!(done > 20, "workers did {done} jobs");
    finish(cluster).await
}
