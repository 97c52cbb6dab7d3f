//! NATS is stopped while workers hold jobs: the server goes on alone, each job ends once, and workers are used again later.

use serde_json::Value;
use system_tests::mock_llm::{GatedEndpoint, HOLD_ACTION};
use system_tests::worker_cluster::{WorkerProcess, nats_options};
use system_tests::{ApiClient, wait_until};

use super::servers::{OptionServer, done_remotely, wait_for_kind};
use super::*;
use crate::design::{create, report_losses, request_design, wait_for_critiques};
use crate::trajectories::{
    ack, assert_group_replays, claim, counted_episodes, ids, number, policy, put_policy,
};

/// Options with which a server or a worker finds its language model for designs or rollouts.
fn model_options(purpose: &str, endpoint: &GatedEndpoint) -> [String; 4] {
    let url = format!("{}/v1", endpoint.url());
    [format!("--{purpose}-url"), url, format!("--{purpose}-model"), "mock".to_owned()]
}

/// A server and a worker with a language model each. That of the server answers at once, that of the worker is held.
struct Models {
    server: OptionServer,
    held: GatedEndpoint,
    /// Keeps answering the server.
    _own: GatedEndpoint,
    _worker: WorkerProcess,
}

impl Models {
    async fn start(nats: &NatsServer, purpose: &str, jobs: &str, content: &'static str) -> Self {
        let (own, held) = (GatedEndpoint::start(content).await, GatedEndpoint::start(content).await);
        own.release(10_000);
        let options = [nats_options(&nats.url()), model_options(purpose, &own).to_vec()].concat();
        let server = OptionServer::start(&options);
        let url = nats.url();
        let model = model_options(purpose, &held);
        let model: Vec<&str> = model.iter().map(String::as_str).collect();
        let worker = [&["--nats", &url, "--jobs", jobs], model.as_slice()].concat();
        let worker = WorkerProcess::start_with_options(&worker);
        Self { server, held, _own: own, _worker: worker }
    }
}

/// Waits until the server says that NATS is away.
async fn wait_for_degradation(api: &ApiClient) {
    wait_until("the server is degraded", async || {
        let health: Value = api.get("/readyz").await.expect(200);
        health["status"] == "degraded" && health["reason"].as_str().unwrap().contains("NATS")
    })
    .await;
}

/// Waits until workers take jobs again.
async fn wait_for_recovery(api: &ApiClient, kind: &str) {
    wait_for_kind(api, kind).await;
    assert_eq!(api.get("/readyz").await.expect(200), json!({"status": "ok"}));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_rollout_ends_once_although_nats_stops() {
    let Some(mut nats) = NatsServer::start() else { return };
    let models = Models::start(&nats, "policy", "rollout", HOLD_ACTION).await;
    let api = models.server.api();
    crate::trajectories::create_run(&api, "run", json!({})).await;
    wait_for_kind(&api, "rollout_chat").await;
    let settings = json!({"policy": "chat", "max_unacknowledged_groups": 1});
    let _ = put_policy(&api, "run", settings).await.expect(200);
    models.held.wait_for_requests(2).await;
    nats.kill();
    wait_for_degradation(&api).await;
    let group = claim(&api, "run", json!({"wait_s": 50})).await.remove(0);
    assert_group_replays(&group);
    assert_eq!(done_remotely(&api).await, 0, "the server rolled it out");

    nats.resume();
    wait_for_recovery(&api, "rollout_chat").await;
    // The worker finishes its group now, and the server ignores it.
    models.held.release(10_000);
    let (mut groups, mut last) = (1, group);
    // The server rolls out groups itself while the worker is busy with the old one.
    while done_remotely(&api).await == 0 {
        assert!(groups < 40, "the worker is used again");
        let _ = ack(&api, "run", &ids(&[last])).await;
        last = claim(&api, "run", json!({"wait_s": 50})).await.remove(0);
        assert_group_replays(&last);
        groups += 1;
    }
    let state = policy(&api, "run").await;
    let counts = (number(&state["groups"]), number(&state["episodes"]), number(&state["failed"]));
    assert_eq!(counts, (groups, 2 * groups, 0));
    assert_eq!(counted_episodes(&api, "run").await, 2 * groups);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_design_ends_once_although_nats_stops() {
    let Some(mut nats) = NatsServer::start() else { return };
    let models = Models::start(&nats, "llm", "design", LAYOUTS).await;
    let api = models.server.api();
    create(&api, json!({"designer": "off"})).await;
    report_losses(&api).await;
    wait_for_critiques(&api).await;
    wait_for_kind(&api, "design_llm").await;
    let request = json!({"count": 1, "designer": "llm"});
    let stop = async {
        models.held.wait_for_requests(1).await;
        nats.kill();
        wait_for_degradation(&api).await;
    };
    let (designed, ()) = tokio::join!(request_design(&api, request.clone()), stop);
    let expect = |designed: &Value| {
        assert_eq!((&designed["state"], &designed["admitted"]), (&json!("done"), &json!(1)), "{designed}");
        assert_eq!((&designed["model"], &designed["warnings"]), (&json!("mock"), &json!([])), "{designed}");
    };
    expect(&designed);
    assert_eq!(done_remotely(&api).await, 0, "the server designed");

    nats.resume();
    wait_for_recovery(&api, "design_llm").await;
    models.held.release(10_000);
    let (mut requested, mut admitted) = (1, 1);
    // The server designs itself while the worker is busy with the old request.
    while done_remotely(&api).await == 0 {
        assert!(requested < 20, "the worker is used again");
        let designed = request_design(&api, request.clone()).await;
        // The model knows two layouts.
        if requested == 1 {
            expect(&designed);
        }
        assert_eq!(designed["state"], "done", "{designed}");
        admitted += number(&designed["admitted"]);
        requested += 1;
    }
    let list = api.get("/v1/runs/run/designs").await.expect(200);
    let designs = list["designs"].as_array().unwrap().iter();
    let active = designs.filter(|design| design["state"] == "active").count();
    assert_eq!(i64::try_from(active).unwrap(), admitted, "each request has its layouts once: {list:#}");
    let requests = api.get("/v1/runs/run/designs/requests").await.expect(200);
    assert_eq!(requests["requests"].as_array().unwrap().len(), requested, "{requests}");
}
