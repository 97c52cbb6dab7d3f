//! Server rollouts and kills: no acknowledged group is lost, none counts twice, and interrupted groups are run again.

use std::collections::BTreeSet;

use serde_json::json;
use system_tests::{Server, ServerProcess, wait_until};

use super::chat_policy::model_config;
use super::{
    ack, all_leases, assert_group_replays, claim, counted_episodes, create_run, ids, number, policy,
    put_policy, read, wait_for_full_feed, wait_for_rollouts,
};

#[tokio::test]
async fn kills_lose_no_pushed_group_and_count_none_twice() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("killed.sqlite3");
    let mut process = ServerProcess::start(&db);
    create_run(&process.api(), "run", json!({"group_size": 4})).await;
    let _ = put_policy(&process.api(), "run", json!({"policy": "random", "max_unacknowledged_groups": 32}))
        .await
        .expect(200);
    let (mut acknowledged, mut delivered) = (BTreeSet::new(), BTreeSet::new());
    for round in 0..6u64 {
        let api = process.api();
        let groups = claim(&api, "run", json!({"limit": 4, "wait_s": 30, "ttl_s": 1})).await;
        groups.iter().for_each(assert_group_replays);
        delivered.extend(ids(&groups));
        let half: Vec<i64> = ids(&groups).into_iter().step_by(2).collect();
        let acked = ack(&api, "run", &half).await;
        assert_eq!(acked["unknown"], json!([]));
        acknowledged.extend(half);
        let before = read(&api, "run", "after=0&limit=256").await;
        // Tests the passing of time: the kill comes at another moment of the rollouts in each round.
        tokio::time::sleep(std::time::Duration::from_millis(7 * round)).await;
        process.kill();
        process = ServerProcess::start(&db);
        let after = read(&process.api(), "run", "after=0&limit=256").await;
        for group in &before {
            let same =
                after.iter().find(|other| other["id"] == group["id"]).expect("a pushed group is stored");
            assert_eq!(same["episodes"], group["episodes"]);
        }
        delivered.extend(ids(&after));
    }
    let api = process.api();
    let _ = put_policy(&api, "run", json!({"policy": "off"})).await.expect(200);
    wait_for_rollouts(&api).await;
    // No lease of a killed server is active, no episode counts twice, and every group is delivered.
    let leases = all_leases(&api).await;
    assert!(leases.iter().all(|lease| lease["status"] != "active"), "{leases:?}");
    let state = policy(&api, "run").await;
    assert_eq!(counted_episodes(&api, "run").await, number(&state["episodes"]));
    assert_eq!(number(&state["episodes"]), 4 * number(&state["groups"]));
    let completed = leases.iter().filter(|lease| lease["status"] == "done").count();
    assert_eq!(completed as i64, number(&state["groups"]));
    // A delivery without an acknowledgement times out after 1 s: its group is delivered again.
    let mut remaining = BTreeSet::new();
    wait_until("every group without an acknowledgement is delivered", async || {
        remaining.extend(ids(&claim(&api, "run", json!({"limit": 64})).await));
        let feed = policy(&api, "run").await["feed"].clone();
        remaining.len() as i64 == number(&feed["waiting"]) + number(&feed["delivered"])
    })
    .await;
    assert!(remaining.is_disjoint(&acknowledged), "no acknowledged group is delivered again");
    let all: BTreeSet<i64> = remaining.union(&acknowledged).copied().collect();
    assert!(delivered.is_subset(&all), "groups without an acknowledgement are delivered again");
    assert_eq!(all.len() as i64, number(&state["groups"]));
}

/// A group that was in progress at a restart is released and run again.
#[tokio::test]
async fn interrupted_group_is_released_and_run_again() {
    let slow = system_tests::mock_llm::chat_response(system_tests::mock_llm::HOLD_ACTION);
    let slow = slow.set_delay(std::time::Duration::from_millis(400));
    let mock = system_tests::mock_llm::start_endpoint([slow]).await;
    let mut config = model_config(&mock.uri());
    config.timeout = std::time::Duration::from_secs(5);
    let endpoint = rollout::Endpoint { llm: llm::LlmClient::new(config).unwrap(), temperature: None };
    let mut server = Server::with_config(move |config| orchestrator::service::Config {
        endpoint: Some(endpoint.clone()),
        ..config
    })
    .await;
    create_run(&server.api(), "run", json!({"group_size": 2})).await;
    let _ = put_policy(&server.api(), "run", json!({"policy": "chat", "max_unacknowledged_groups": 1}))
        .await
        .expect(200);
    wait_until("a group is leased", async || !all_leases(&server.api()).await.is_empty()).await;
    server.restart().await;
    let _ = put_policy(&server.api(), "run", json!({"policy": "hold", "max_unacknowledged_groups": 1}))
        .await
        .expect(200);
    wait_for_full_feed(&server.api(), "run").await;
    let leases = all_leases(&server.api()).await;
    assert_eq!(leases[0]["status"], "released");
    assert_eq!(leases.last().unwrap()["status"], "done");
    assert_eq!(counted_episodes(&server.api(), "run").await, 2);
}
