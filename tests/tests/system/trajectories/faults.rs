//! An endpoint that fails costs a run nothing but time: its episodes are failed, never low.

use std::sync::atomic::Ordering;
use std::time::Duration;

use designer::llm::{Llm, LlmConfig};
use orchestrator::clock::Clock;
use orchestrator::service::Config;
use orchestrator::training::rollout::Endpoint;
use serde_json::json;
use system_tests::Server;
use system_tests::model::{HOLD, KEY, completion, endpoint, says, sent};
use tokio::net::TcpListener;
use wiremock::ResponseTemplate;

use super::chat::{model, server};
use super::{check, counted, number, policy, pull, put, run, until};

/// What no answer, log line or file may hold.
fn keyless(text: &str) {
    assert!(!text.contains(KEY), "{text}");
}

#[tokio::test]
async fn an_endpoint_that_fails_is_told_of_and_lowers_nothing() {
    let status = |status: u16| ResponseTemplate::new(status).set_body_string(format!("no, {KEY}"));
    let cases = [
        ("down", None, "cannot be reached"),
        ("slow", Some(says(HOLD).set_delay(Duration::from_secs(9))), "within"),
        ("500", Some(status(500)), "status 500"),
        ("401", Some(status(401)), "status 401"),
        ("429", Some(status(429).insert_header("retry-after", "1")), "rate limited"),
        (
            "nonsense",
            Some(ResponseTemplate::new(200).set_body_string(format!("<html>{KEY}</html>"))),
            "no sense",
        ),
        ("no choices", Some(ResponseTemplate::new(200).set_body_json(json!({"choices": []}))), "no sense"),
    ];
    for (name, answer, words) in cases {
        // A port that was free a moment ago.
        let free = TcpListener::bind("127.0.0.1:0").await.unwrap().local_addr().unwrap();
        let mock = match answer {
            Some(answer) => Some(endpoint([answer]).await),
            None => None,
        };
        let base = mock.as_ref().map_or_else(|| format!("http://{free}"), wiremock::MockServer::uri);
        let mut server = server(LlmConfig { concurrency: 2, ..model(&base) }).await;
        let api = server.api();
        run(&api, "run", json!({"group_size": 4})).await;
        let _ = put(&api, "run", json!({"policy": "chat"})).await.expect(200);
        let told = until(&api, "run", name, |told| number(&told["failed"]) >= 4).await;
        // Others may have found the breaker open by then, which says why.
        let why = told["trouble"]["words"].as_str().unwrap();
        assert!(why.contains(words), "{name}: {why}");
        assert_eq!((number(&told["groups"]), number(&told["feed"]["waiting"])), (0, 0), "{name}");
        assert!(pull(&api, "run", "").await.is_empty());
        assert_eq!(counted(&api, "run").await, 0, "{name}: never a low score");
        let standing = api.get("/v1/runs/run/mastery").await.expect(200);
        assert!(standing["tasks"][0]["plain"]["failed"].as_u64().unwrap() >= 4, "{standing}");
        // A dead endpoint is left alone.
        tokio::time::sleep(Duration::from_millis(2500)).await;
        let calls = match &mock {
            Some(mock) => sent(mock).await.len(),
            None => 0,
        };
        assert!(calls <= 8, "{name}: {calls} calls");
        for path in ["policy", "leases", "mastery", "failures"] {
            keyless(&api.get(&format!("/v1/runs/run/{path}")).await.body.to_string());
        }
        let leases = api.get("/v1/runs/run/leases").await.expect(200);
        assert!(
            leases["leases"].as_array().unwrap().len() <= 3,
            "{name}: scenarios are not used up: {leases}"
        );
        server.stop().await;
        let stored = std::fs::read(server.db()).unwrap();
        assert!(
            !stored.windows(KEY.len()).any(|window| window == KEY.as_bytes()),
            "{name}: the key is stored"
        );
    }
}

/// After a failure in passing the run goes on by itself.
#[tokio::test]
async fn an_endpoint_that_comes_back_is_flown_with_again() {
    let mock = endpoint([ResponseTemplate::new(401), says(HOLD)]).await;
    let server = server(model(&mock.uri())).await;
    let api = server.api();
    run(&api, "run", json!({"group_size": 1})).await;
    let _ = put(&api, "run", json!({"policy": "chat", "ahead": 2})).await.expect(200);
    let told = until(&api, "run", "full", |told| told["feed"]["full"] == true).await;
    assert_eq!(number(&told["failed"]), 1);
    assert!(told["trouble"]["words"].as_str().unwrap().contains("401"));
    assert_eq!(counted(&api, "run").await, 2);
}

/// The flight of a model may outlast its lease, where the machine slept: what comes too late counts for nothing, low or high, is
/// fed to nobody, and its scenario is flown again.
#[tokio::test]
async fn a_group_whose_lease_is_over_before_it_is_flown_counts_for_nothing() {
    let (clock, hand) = Clock::manual(1_790_000_000_000);
    // A flight of 50 steps takes 3 s.
    let mock = endpoint([says(HOLD).set_delay(Duration::from_millis(60))]).await;
    let endpoint = Endpoint { llm: Llm::new(model(&mock.uri())).unwrap(), temperature: None };
    let server = Server::set_up(move |config| Config {
        clock: clock.clone(),
        endpoint: Some(endpoint.clone()),
        ..config
    })
    .await;
    let api = server.api();
    run(&api, "run", json!({"group_size": 1})).await;
    let _ = put(&api, "run", json!({"policy": "chat", "ahead": 1})).await.expect(200);
    while sent(&mock).await.is_empty() {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    hand.fetch_add(601_000, Ordering::SeqCst);
    let told = until(&api, "run", "too late", |told| !told["trouble"].is_null()).await;
    assert_eq!(told["trouble"]["words"], "its lease was over before the group was flown");
    assert_eq!((number(&told["groups"]), number(&told["failed"])), (0, 0));
    let groups = pull(&api, "run", "wait_s=50").await;
    check(&groups[0]);
    let leases = api.get("/v1/runs/run/leases").await.expect(200);
    let lease = |at: usize| leases["leases"][at]["lease"].as_str().unwrap();
    assert_eq!(
        (&leases["leases"][0]["status"], &leases["leases"][1]["status"]),
        (&json!("expired"), &json!("done"))
    );
    assert_eq!(groups[0]["lease"], lease(1));
    let first = api.get(&format!("/v1/runs/run/leases/{}", lease(0))).await.expect(200);
    assert_eq!(first["groups"][0]["state"], "lost");
    assert_eq!(groups[0]["scenario"], first["groups"][0]["scenario"], "it is offered again");
    let standing = api.get("/v1/runs/run/mastery").await.expect(200);
    let plain = &standing["tasks"][0]["plain"];
    assert_eq!((number(&plain["episodes"]), number(&plain["expired"])), (1, 1), "{plain}");
    let flown = format!("/v1/runs/run/episodes/ep_{}_0", lease(0));
    assert_eq!(api.get(&flown).await.expect(200)["state"], "late");
}

/// One sibling of many is lost: the others count, and say so.
#[tokio::test]
async fn a_group_counts_from_half_of_its_episodes() {
    let mock = endpoint([ResponseTemplate::new(400), says(HOLD)]).await;
    let server = server(model(&mock.uri())).await;
    let api = server.api();
    run(&api, "run", json!({"group_size": 3})).await;
    let _ = put(&api, "run", json!({"policy": "chat", "ahead": 1})).await.expect(200);
    let groups = pull(&api, "run", "wait_s=50").await;
    check(&groups[0]);
    assert_eq!((&groups[0]["failed"], groups[0]["episodes"].as_array().unwrap().len()), (&json!(1), 2));
    let now = policy(&api, "run").await;
    assert_eq!((number(&now["failed"]), number(&now["episodes"])), (1, 2));
    assert_eq!(counted(&api, "run").await, 2);
}

/// An endpoint that repeats the key finds it crossed out, and tokens that would spell it are not kept.
#[tokio::test]
async fn the_key_is_in_no_trajectory() {
    let mut answer = completion(&format!("{{\"burns\": []}} said with {KEY}"));
    answer["choices"][0]["token_ids"] = json!([115, 107, 45]);
    let mock = endpoint([ResponseTemplate::new(200).set_body_json(answer)]).await;
    let server = server(LlmConfig { tokens: true, ..model(&mock.uri()) }).await;
    let api = server.api();
    run(&api, "run", json!({"group_size": 1})).await;
    let _ = put(&api, "run", json!({"policy": "chat", "ahead": 1})).await.expect(200);
    let groups = pull(&api, "run", "wait_s=50").await;
    let text = groups[0].to_string();
    keyless(&text);
    assert!(text.contains("[key]") && !text.contains("\"tokens\""), "{text}");
}

/// A budget that is spent is no reason to count anything low, and outlives the server.
#[tokio::test]
async fn a_spent_budget_stays_spent() {
    let mock = endpoint([says(HOLD)]).await;
    let mut config = model(&mock.uri());
    config.max_tokens = 100;
    config.concurrency = 1; // one group at a time
    // One episode of 50 steps at 920 tokens.
    config.tokens_per_run = Some(47_500);
    let base = config;
    let mut server = Server::set_up(move |config| {
        let llm = Llm::new(base.clone()).unwrap();
        let endpoint = Some(Endpoint { llm, temperature: None });
        Config { endpoint, ..config }
    })
    .await;
    run(&server.api(), "run", json!({"group_size": 1})).await;
    let _ = put(&server.api(), "run", json!({"policy": "chat", "ahead": 9})).await.expect(200);
    let told = until(&server.api(), "run", "spent", |told| number(&told["failed"]) >= 1).await;
    assert!(told["trouble"]["words"].as_str().unwrap().contains("budget"), "{told}");
    assert_eq!(number(&told["groups"]), 1);
    server.restart().await;
    until(&server.api(), "run", "spent again", |now| number(&now["failed"]) > number(&told["failed"])).await;
    assert_eq!(counted(&server.api(), "run").await, 1);
    assert_eq!(number(&policy(&server.api(), "run").await["groups"]), 1);
}
