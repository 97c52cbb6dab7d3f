//! Built-in policies.

use std::time::Instant;

use serde_json::{Value, json};
use system_tests::Server;

use super::{SOON, ack, check, counted, ids, number, policy, pull, put, run, until};

/// Groups come, what they say is what was flown, and mastery moves by it as by any trainer's results.
#[tokio::test]
async fn what_a_built_in_policy_flies_is_true_and_moves_mastery() {
    let server = Server::start().await;
    let api = server.api();
    let more = json!({"placement": true, "contested_share": 0.5, "group_size": 4, "target": "mastery",
                      "tasks": ["kessler/survival", "kessler/eco_station"]});
    run(&api, "run", more).await;
    let _ = put(&api, "run", json!({"policy": "heuristic", "version": 3, "ahead": 8})).await.expect(200);
    let (begun, mut seen) = (Instant::now(), Vec::new());
    let moved = loop {
        let groups = pull(&api, "run", "limit=8&wait_s=10").await;
        groups.iter().for_each(check);
        for group in &groups {
            assert_eq!(
                (&group["run"], &group["policy"], &group["policy_version"]),
                (&json!("run"), &json!("heuristic"), &json!(3))
            );
            let lease = group["lease"].as_str().unwrap();
            let episodes = group["episodes"].as_array().unwrap();
            let names: Vec<&str> = episodes.iter().map(|e| e["id"].as_str().unwrap()).collect();
            let expected: Vec<String> = (0..4).map(|index| format!("ep_{lease}_{index}")).collect();
            assert_eq!(names, expected);
            let shown = api.get(&format!("/v1/runs/run/leases/{lease}")).await.expect(200);
            let ours = &shown["groups"][0];
            for name in
                ["task", "level", "role", "seed", "scenario", "contested", "bracket", "group", "layout"]
            {
                assert_eq!(group[name], ours[name], "{name}");
            }
            assert_eq!((&group["recipe"], &shown["status"]), (&shown["recipes"][0], &json!("done")));
        }
        seen.extend(ids(&groups));
        ack(&api, "run", &ids(&groups)).await;
        let history = api.get("/v1/runs/run/mastery/history").await.expect(200);
        if !history["moves"].as_array().unwrap().is_empty() {
            break history;
        }
        assert!(begun.elapsed() < SOON, "nothing moved: {history}");
    };
    assert!(moved["moves"][0]["evidence"].is_object(), "{moved}");
    // No group is lost and none is told twice, and every one is counted.
    let _ = put(&api, "run", json!({"policy": "off"})).await.expect(200);
    tokio::time::sleep(std::time::Duration::from_millis(500)).await;
    let now = policy(&api, "run").await;
    assert_eq!((&now["policy"], &now["version"], &now["failed"]), (&json!("off"), &json!(3), &json!(0)));
    seen.extend(ids(&pull(&api, "run", "limit=256").await));
    assert!(seen.windows(2).all(|pair| pair[0] < pair[1]), "{seen:?}");
    assert_eq!(seen.len() as i64, number(&now["groups"]));
    assert_eq!(counted(&api, "run").await, 4 * seen.len() as i64);
    assert_eq!(number(&now["episodes"]), 4 * seen.len() as i64);
}

/// Siblings of a policy with chance in it fly differently; what was seen is what a replay shows.
#[tokio::test]
async fn siblings_differ_where_there_is_chance_and_observations_are_what_was_seen() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({"tasks": ["docking/single"], "group_size": 3})).await;
    let _ = put(&api, "run", json!({"policy": "random", "ahead": 1})).await.expect(200);
    let groups = pull(&api, "run", "wait_s=30").await;
    let group = &groups[0];
    check(group);
    let episodes = group["episodes"].as_array().unwrap();
    assert!(episodes.iter().all(|one| one["steps"][0]["action"] != episodes[0]["steps"][0]["action"]
        || one["id"] == episodes[0]["id"]));
    let name = episodes[1]["id"].as_str().unwrap();
    let shown = api.get(&format!("/v1/runs/run/episodes/{name}/replay?telemetry=true")).await.expect(200);
    let frames = shown["frames"].as_array().unwrap();
    let steps = episodes[1]["steps"].as_array().unwrap();
    assert_eq!(frames.len(), steps.len() + 1);
    let bare = |told: &Value| {
        let mut told = told.clone();
        told.as_object_mut().unwrap().retain(|name, _| name != "reward" && name != "done");
        told
    };
    for (step, frame) in steps.iter().zip(frames) {
        assert_eq!(step["observation"], bare(&frame["observation"]));
    }
    assert_eq!(episodes[1]["last_observation"], bare(&frames.last().unwrap()["observation"]));
    // Without observations nothing else is missing.
    ack(&api, "run", &ids(&groups)).await;
    let wish = json!({"policy": "random", "observations": "none", "ahead": 1});
    let _ = put(&api, "run", wish).await.expect(200);
    let begun = Instant::now();
    loop {
        let groups = pull(&api, "run", "wait_s=30").await;
        groups.iter().for_each(check);
        ack(&api, "run", &ids(&groups)).await;
        if groups.iter().any(|group| group["observations"] == "none") {
            let text = serde_json::to_string(&groups).unwrap();
            assert!(!text.contains("\"observation\"") && !text.contains("last_observation"));
            break;
        }
        assert!(begun.elapsed() < SOON);
    }
}

#[tokio::test]
async fn the_bound_stops_who_flies_and_acknowledging_starts_them_again() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({})).await;
    let _ = put(&api, "run", json!({"policy": "hold", "ahead": 3})).await.expect(200);
    let full =
        |groups: i64| move |told: &Value| told["feed"]["full"] == true && number(&told["groups"]) == groups;
    until(&api, "run", "full", full(3)).await;
    // Longer than the worker looks by itself.
    tokio::time::sleep(std::time::Duration::from_millis(1500)).await;
    assert_eq!(number(&policy(&api, "run").await["groups"]), 3);
    let groups = pull(&api, "run", "limit=2").await;
    assert_eq!(number(&policy(&api, "run").await["feed"]["delivered"]), 2);
    assert_eq!(number(&policy(&api, "run").await["groups"]), 3, "delivered is not acknowledged");
    ack(&api, "run", &ids(&groups)).await;
    until(&api, "run", "full again", full(5)).await;
    let leases = api.get("/v1/runs/run/leases").await.expect(200);
    assert_eq!(leases["leases"].as_array().unwrap().len(), 5, "nothing is leased that there is no room for");
}

#[tokio::test]
async fn a_paused_run_makes_nothing_and_versions_only_rise() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({})).await;
    let _ = api.post("/v1/runs/run/pause", json!({})).await.expect(200);
    let _ = put(&api, "run", json!({"policy": "hold", "version": 4, "ahead": 2})).await.expect(200);
    tokio::time::sleep(std::time::Duration::from_millis(1500)).await;
    assert_eq!(number(&policy(&api, "run").await["groups"]), 0);
    let leases = api.get("/v1/runs/run/leases").await.expect(200);
    assert_eq!(leases["leases"], json!([]));
    let _ = api.post("/v1/runs/run/resume", json!({})).await.expect(200);
    until(&api, "run", "full", |told| told["feed"]["full"] == true).await;
    let refused = put(&api, "run", json!({"policy": "hold", "version": 3})).await.expect(422);
    assert_eq!(refused["field"], "version");
    assert_eq!(policy(&api, "run").await["version"], 4);
    // Left out it stays; raised it is what groups begun later carry.
    assert_eq!(put(&api, "run", json!({"policy": "hold", "ahead": 2})).await.expect(200)["version"], 4);
    let _ = put(&api, "run", json!({"policy": "frozen", "version": 9, "ahead": 4})).await.expect(200);
    until(&api, "run", "full", |told| told["feed"]["full"] == true).await;
    let groups = pull(&api, "run", "").await;
    let versions: Vec<(&str, i64)> =
        groups.iter().map(|g| (g["policy"].as_str().unwrap(), number(&g["policy_version"]))).collect();
    assert_eq!(versions, [("hold", 4), ("hold", 4), ("frozen", 9), ("frozen", 9)]);
}
