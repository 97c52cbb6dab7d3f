//! Faults of the model endpoint: episodes fail and never count as low scores, and the API key is not exposed.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clock::{Clock, ManualClock};
use llm::{LlmClient, LlmConfig};
use orchestrator::service::Config;
use rollout::Endpoint;
use serde_json::json;
use system_tests::mock_llm::{
    API_KEY, ClosedPort, GatedEndpoint, HOLD_ACTION, chat_completion, chat_response, contains_api_key,
    received_bodies, start_endpoint,
};
use system_tests::{Server, wait_until};
use wiremock::ResponseTemplate;

use super::chat_policy::{model_config, start_server};
use super::{
    assert_group_replays, claim, counted_episodes, create_run, number, policy, put_policy,
    wait_for_full_feed, wait_for_policy,
};

/// Checks that a text does not have the API key.
fn assert_has_no_key(text: &str) {
    assert!(!text.contains(API_KEY), "{text}");
}

/// Returns the name, the response and a part of the reported reason of each fault. A response of `None` is a closed port.
fn endpoint_faults() -> [(&'static str, Option<ResponseTemplate>, &'static str); 7] {
    let status = |status: u16| ResponseTemplate::new(status).set_body_string(format!("no, {API_KEY}"));
    [
        ("down", None, "cannot be reached"),
        ("slow", Some(chat_response(HOLD_ACTION).set_delay(Duration::from_secs(300))), "within"),
        ("500", Some(status(500)), "status 500"),
        ("401", Some(status(401)), "status 401"),
        ("429", Some(status(429).insert_header("retry-after", "1")), "limits the rate of requests"),
        (
            "nonsense",
            Some(ResponseTemplate::new(200).set_body_string(format!("<html>{API_KEY}</html>"))),
            "response is invalid",
        ),
        (
            "no choices",
            Some(ResponseTemplate::new(200).set_body_json(json!({"choices": []}))),
            "response is invalid",
        ),
    ]
}

#[tokio::test]
async fn endpoint_faults_are_reported_and_do_not_count() {
    let closed = ClosedPort::reserve();
    for (name, response, reason) in endpoint_faults() {
        let mock = match response {
            Some(response) => Some(start_endpoint([response]).await),
            None => None,
        };
        let base = match &mock {
            Some(mock) => mock.uri(),
            None => closed.url(),
        };
        let mut model_config = LlmConfig { concurrency: 2, ..model_config(&base) };
        if name == "slow" {
            model_config.timeout = Duration::from_secs(2);
        }
        let mut server = start_server(model_config).await;
        let api = server.api();
        create_run(&api, "run", json!({"group_size": 4})).await;
        let start = Instant::now();
        let _ = put_policy(&api, "run", json!({"policy": "chat"})).await.expect(200);
        let state = wait_for_policy(&api, "run", name, |policy| number(&policy["failed"]) >= 4).await;
        // Later episodes may have failed because of the open circuit breaker, which names the same reason.
        let why = state["last_error"]["message"].as_str().unwrap();
        assert!(why.contains(reason), "{name}: {why}");
        assert_eq!((number(&state["groups"]), number(&state["feed"]["waiting"])), (0, 0), "{name}");
        assert!(claim(&api, "run", json!({})).await.is_empty());
        assert_eq!(counted_episodes(&api, "run").await, 0, "{name}: never a low score");
        let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
        assert!(mastery["tasks"][0]["results"]["failed"].as_u64().unwrap() >= 4, "{mastery}");
        // Tests the passing of time: a failing endpoint gets few requests in it.
        tokio::time::sleep(Duration::from_millis(2500)).await;
        let calls = match &mock {
            Some(mock) => received_bodies(mock).await.len(),
            None => 0,
        };
        assert!(calls <= 8, "{name}: {calls} calls");
        for path in ["policy", "leases", "mastery", "failures"] {
            assert_has_no_key(&api.get(&format!("/v1/runs/run/{path}")).await.body.to_string());
        }
        let leases = api.get("/v1/runs/run/leases").await.expect(200);
        // The pause after a failed group is 1 s at first, and doubles.
        let pauses = (1.0 + start.elapsed().as_secs_f64()).log2().floor();
        assert!(
            leases["leases"].as_array().unwrap().len() <= 1 + pauses as usize,
            "{name}: few scenarios are leased: {leases}"
        );
        server.stop().await;
        let stored = std::fs::read(server.db_path()).unwrap();
        assert!(!contains_api_key(&stored), "{name}: the key is stored");
    }
}

/// Rollouts continue by themselves after a temporary fault.
#[tokio::test]
async fn rollouts_continue_after_a_temporary_fault() {
    let mock = start_endpoint([ResponseTemplate::new(401), chat_response(HOLD_ACTION)]).await;
    let server = start_server(model_config(&mock.uri())).await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 1})).await;
    let _ =
        put_policy(&api, "run", json!({"policy": "chat", "max_unacknowledged_groups": 2})).await.expect(200);
    let state = wait_for_full_feed(&api, "run").await;
    assert_eq!(number(&state["failed"]), 1);
    assert!(state["last_error"]["message"].as_str().unwrap().contains("401"));
    assert_eq!(counted_episodes(&api, "run").await, 2);
}

/// A rollout may end after its lease, for example after a suspend. Its result does not count and is not delivered, and its
/// scenario is run again.
#[tokio::test]
async fn rollout_that_outlasts_its_lease_does_not_count() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(1_790_000_000_000);
    let model = GatedEndpoint::start(HOLD_ACTION).await;
    let endpoint = Endpoint { llm: LlmClient::new(model_config(model.url())).unwrap(), temperature: None };
    let server = Server::with_config(move |config| Config {
        clock: clock.clone(),
        endpoint: Some(endpoint.clone()),
        ..config
    })
    .await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 1})).await;
    let _ =
        put_policy(&api, "run", json!({"policy": "chat", "max_unacknowledged_groups": 1})).await.expect(200);
    model.wait_for_requests(1).await;
    clock_ms.fetch_add(601_000, Ordering::SeqCst);
    wait_until("the lease expires", async || {
        api.get("/v1/runs/run/leases").await.expect(200)["leases"][0]["status"] == "expired"
    })
    .await;
    // Responses for one episode of 50 steps, so that the next rollout does not end before the state is read.
    model.release(50);
    let state =
        wait_for_policy(&api, "run", "a rollout fails", |policy| !policy["last_error"].is_null()).await;
    assert_eq!(state["last_error"]["message"], "a lease ended before its group was rolled out");
    assert_eq!((number(&state["groups"]), number(&state["failed"])), (0, 0));
    model.release(50);
    let groups = claim(&api, "run", json!({"wait_s": 50})).await;
    assert_group_replays(&groups[0]);
    let leases = api.get("/v1/runs/run/leases").await.expect(200);
    let lease = |at: usize| leases["leases"][at]["lease"].as_str().unwrap();
    assert_eq!(
        (&leases["leases"][0]["status"], &leases["leases"][1]["status"]),
        (&json!("expired"), &json!("done"))
    );
    assert_eq!(groups[0]["lease"], lease(1));
    let first = api.get(&format!("/v1/runs/run/leases/{}", lease(0))).await.expect(200);
    assert_eq!(first["groups"][0]["state"], "lost");
    assert_eq!(groups[0]["scenario"], first["groups"][0]["scenario"], "the scenario is run again");
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    let plain = &mastery["tasks"][0]["results"];
    assert_eq!((number(&plain["episodes"]), number(&plain["expired"])), (1, 1), "{plain}");
    let flown = format!("/v1/runs/run/episodes/ep_{}_0", lease(0));
    assert_eq!(api.get(&flown).await.expect(200)["state"], "late");
}

/// If one episode of a group fails, the others count, and the group has the number of failures.
#[tokio::test]
async fn partly_failed_group_counts() {
    let mock = start_endpoint([ResponseTemplate::new(400), chat_response(HOLD_ACTION)]).await;
    let server = start_server(model_config(&mock.uri())).await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 3})).await;
    let _ =
        put_policy(&api, "run", json!({"policy": "chat", "max_unacknowledged_groups": 1})).await.expect(200);
    let groups = claim(&api, "run", json!({"wait_s": 50})).await;
    assert_group_replays(&groups[0]);
    assert_eq!((&groups[0]["failed"], groups[0]["episodes"].as_array().unwrap().len()), (&json!(1), 2));
    let now = policy(&api, "run").await;
    assert_eq!((number(&now["failed"]), number(&now["episodes"])), (1, 2));
    assert_eq!(counted_episodes(&api, "run").await, 2);
}

/// A key in a response is masked, and tokens that could spell it are not stored.
#[tokio::test]
async fn trajectories_do_not_expose_the_key() {
    let mut response = chat_completion(&format!("{{\"burns\": []}} said with {API_KEY}"));
    response["choices"][0]["token_ids"] = json!([115, 107, 45]);
    let mock = start_endpoint([ResponseTemplate::new(200).set_body_json(response)]).await;
    let server = start_server(LlmConfig { token_details: true, ..model_config(&mock.uri()) }).await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 1})).await;
    let _ =
        put_policy(&api, "run", json!({"policy": "chat", "max_unacknowledged_groups": 1})).await.expect(200);
    let groups = claim(&api, "run", json!({"wait_s": 50})).await;
    let text = groups[0].to_string();
    assert_has_no_key(&text);
    assert!(text.contains("[key]") && !text.contains("\"tokens\""), "{text}");
}

/// Episodes that fail because of a spent budget do not count, and the budget survives a restart.
#[tokio::test]
async fn spent_budget_survives_a_restart() {
    let mock = start_endpoint([chat_response(HOLD_ACTION)]).await;
    let mut config = model_config(&mock.uri());
    config.max_tokens = 100;
    config.concurrency = 1; // one group at a time
    // One episode of 50 steps at 920 tokens.
    config.tokens_per_run = Some(47_500);
    let base = config;
    let mut server = Server::with_config(move |config| {
        let llm = LlmClient::new(base.clone()).unwrap();
        let endpoint = Some(Endpoint { llm, temperature: None });
        Config { endpoint, ..config }
    })
    .await;
    create_run(&server.api(), "run", json!({"group_size": 1})).await;
    let _ = put_policy(&server.api(), "run", json!({"policy": "chat", "max_unacknowledged_groups": 9}))
        .await
        .expect(200);
    let state =
        wait_for_policy(&server.api(), "run", "the budget is spent", |policy| number(&policy["failed"]) >= 1)
            .await;
    assert!(state["last_error"]["message"].as_str().unwrap().contains("budget"), "{state}");
    assert_eq!(number(&state["groups"]), 1);
    server.restart().await;
    wait_for_policy(&server.api(), "run", "the budget is still spent", |policy| {
        number(&policy["failed"]) > number(&state["failed"])
    })
    .await;
    assert_eq!(counted_episodes(&server.api(), "run").await, 1);
    assert_eq!(number(&policy(&server.api(), "run").await["groups"]), 1);
}
