//! A server that is killed in the middle has lost nothing that was acknowledged, and counts nothing twice.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use system_tests::{Process, Server};

use super::chat::model;
use super::{ack, check, counted, ids, number, policy, pull, put, run, until};

#[tokio::test]
async fn what_was_pushed_is_there_and_what_was_half_flown_is_flown_again() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("killed.sqlite3");
    let mut process = Process::start(&db);
    run(&process.api(), "run", json!({"group_size": 4})).await;
    let _ = put(&process.api(), "run", json!({"policy": "random", "ahead": 64})).await.expect(200);
    let (mut done, mut seen) = (BTreeSet::new(), BTreeSet::new());
    for round in 0..6u64 {
        let api = process.api();
        let groups = pull(&api, "run", "limit=4&wait_s=30&ttl_s=1").await;
        groups.iter().for_each(check);
        seen.extend(ids(&groups));
        let half: Vec<i64> = ids(&groups).into_iter().step_by(2).collect();
        let acked = ack(&api, "run", &half).await;
        assert_eq!(acked["unknown"], json!([]));
        done.extend(half);
        let before = pull(&api, "run", "after=0&limit=256").await;
        tokio::time::sleep(std::time::Duration::from_millis(7 * round)).await;
        process.kill();
        process = Process::start(&db);
        let after = pull(&process.api(), "run", "after=0&limit=256").await;
        for group in &before {
            let same = after.iter().find(|now| now["id"] == group["id"]).expect("what was pushed is there");
            assert_eq!(same["episodes"], group["episodes"]);
        }
        seen.extend(ids(&after));
    }
    let api = process.api();
    let _ = put(&api, "run", json!({"policy": "off"})).await.expect(200);
    tokio::time::sleep(std::time::Duration::from_millis(1200)).await;
    // Nothing is held by a server that is gone, nothing counts twice, every group is told.
    let leases = all_leases(&api).await;
    assert!(leases.iter().all(|lease| lease["status"] != "active"), "{leases:?}");
    let now = policy(&api, "run").await;
    assert_eq!(counted(&api, "run").await, number(&now["episodes"]));
    assert_eq!(number(&now["episodes"]), 4 * number(&now["groups"]));
    let flown = leases.iter().filter(|lease| lease["status"] == "done").count();
    assert_eq!(flown as i64, number(&now["groups"]));
    let mut left = BTreeSet::new();
    loop {
        let groups = pull(&api, "run", "limit=64").await;
        if groups.is_empty() {
            break;
        }
        left.extend(ids(&groups));
    }
    assert!(left.is_disjoint(&done), "what was acknowledged does not come again");
    let all: BTreeSet<i64> = left.union(&done).copied().collect();
    assert!(seen.is_subset(&all), "what was seen and not acknowledged comes again");
    assert_eq!(all.len() as i64, number(&now["groups"]));
}

async fn all_leases(api: &system_tests::Api) -> Vec<Value> {
    let (mut all, mut cursor) = (Vec::new(), String::new());
    loop {
        let told = api.get(&format!("/v1/runs/run/leases?limit=500{cursor}")).await.expect(200);
        all.extend(told["leases"].as_array().unwrap().clone());
        match told["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return all,
        }
    }
}

/// A model that is slow holds a group for long: the next server gives it back and has it flown again.
#[tokio::test]
async fn a_group_that_was_being_flown_is_given_back_at_once() {
    let slow = system_tests::model::says(system_tests::model::HOLD);
    let slow = slow.set_delay(std::time::Duration::from_millis(400));
    let mock = system_tests::model::endpoint([slow]).await;
    let mut config = model(&mock.uri());
    config.timeout = std::time::Duration::from_secs(5);
    let endpoint = orchestrator::training::rollout::Endpoint {
        llm: designer::llm::Llm::new(config).unwrap(),
        temperature: None,
    };
    let mut server = Server::set_up(move |config| orchestrator::service::Config {
        endpoint: Some(endpoint.clone()),
        ..config
    })
    .await;
    run(&server.api(), "run", json!({"group_size": 2})).await;
    let _ = put(&server.api(), "run", json!({"policy": "chat", "ahead": 1})).await.expect(200);
    let begun = std::time::Instant::now();
    while all_leases(&server.api()).await.is_empty() {
        assert!(begun.elapsed() < super::SOON);
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    }
    server.restart().await;
    let _ = put(&server.api(), "run", json!({"policy": "hold", "ahead": 1})).await.expect(200);
    until(&server.api(), "run", "full", |told| told["feed"]["full"] == true).await;
    let leases = all_leases(&server.api()).await;
    assert_eq!(leases[0]["status"], "released");
    assert_eq!(leases.last().unwrap()["status"], "done");
    assert_eq!(counted(&server.api(), "run").await, 2);
}
