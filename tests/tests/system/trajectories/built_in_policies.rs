//! Server rollouts of built-in policies.

use std::time::{Duration, Instant};

use serde_json::{Value, json};
use system_tests::{ApiClient, Server};

use super::{
    ack, assert_group_replays, claim, counted_episodes, create_run, ids, number, policy, put_policy,
    wait_for_full_feed, wait_for_policy, wait_for_rollouts,
};

/// Time that a loop over the feed may take.
const MAX_WAIT: Duration = Duration::from_secs(300);

/// Groups of server rollouts are replayable, and count for mastery like results of a trainer.
#[tokio::test]
async fn server_rollouts_replay_and_count_for_mastery() {
    let server = Server::start().await;
    let api = server.api();
    let overrides = json!({"placement": true, "contested_share": 0.5, "group_size": 4, "target": "mastery",
                      "tasks": ["kessler/survival", "kessler/eco_station"]});
    create_run(&api, "run", overrides).await;
    let _ =
        put_policy(&api, "run", json!({"policy": "heuristic", "version": 3, "max_unacknowledged_groups": 8}))
            .await
            .expect(200);
    let (start, mut seen) = (Instant::now(), Vec::new());
    let moved = loop {
        let groups = claim(&api, "run", json!({"limit": 8, "wait_s": 10})).await;
        groups.iter().for_each(assert_group_replays);
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
            let leased = &shown["groups"][0];
            for name in
                ["task", "level", "role", "seed", "scenario", "contested", "bracket", "group", "layout"]
            {
                assert_eq!(group[name], leased[name], "{name}");
            }
            assert_eq!((&group["recipe"], &shown["status"]), (&shown["recipes"][0], &json!("done")));
        }
        seen.extend(ids(&groups));
        ack(&api, "run", &ids(&groups)).await;
        let history = api.get("/v1/runs/run/level_moves").await.expect(200);
        if !history["moves"].as_array().unwrap().is_empty() {
            break history;
        }
        assert!(start.elapsed() < MAX_WAIT, "the level did not move: {history}");
    };
    assert!(moved["moves"][0]["evidence"].is_object(), "{moved}");
    // Every group is delivered once, and all its episodes count.
    let _ = put_policy(&api, "run", json!({"policy": "off"})).await.expect(200);
    wait_for_rollouts(&api).await;
    let now = policy(&api, "run").await;
    assert_eq!((&now["policy"], &now["version"], &now["failed"]), (&json!("off"), &json!(3), &json!(0)));
    seen.extend(ids(&claim(&api, "run", json!({"limit": 256})).await));
    assert!(seen.windows(2).all(|pair| pair[0] < pair[1]), "{seen:?}");
    assert_eq!(seen.len() as i64, number(&now["groups"]));
    assert_eq!(counted_episodes(&api, "run").await, 4 * seen.len() as i64);
    assert_eq!(number(&now["episodes"]), 4 * seen.len() as i64);
}

/// Episodes of a group differ for a stochastic policy, and their observations equal those of a replay.
#[tokio::test]
async fn stochastic_episodes_differ_and_have_true_observations() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"tasks": ["docking/single"], "group_size": 3})).await;
    let _ = put_policy(&api, "run", json!({"policy": "random", "max_unacknowledged_groups": 1}))
        .await
        .expect(200);
    let groups = claim(&api, "run", json!({"wait_s": 30})).await;
    let group = &groups[0];
    assert_group_replays(group);
    let episodes = group["episodes"].as_array().unwrap();
    assert!(episodes.iter().all(|one| one["steps"][0]["action"] != episodes[0]["steps"][0]["action"]
        || one["id"] == episodes[0]["id"]));
    let name = episodes[1]["id"].as_str().unwrap();
    let shown = api.get(&format!("/v1/runs/run/episodes/{name}/replay?telemetry=true")).await.expect(200);
    let frames = shown["frames"].as_array().unwrap();
    let steps = episodes[1]["steps"].as_array().unwrap();
    assert_eq!(frames.len(), steps.len() + 1);
    let without_end = |observation: &Value| {
        let mut observation = observation.clone();
        observation.as_object_mut().unwrap().retain(|name, _| name != "reward" && name != "done");
        observation
    };
    for (step, frame) in steps.iter().zip(frames) {
        assert_eq!(step["observation"], without_end(&frame["observation"]));
    }
    assert_eq!(episodes[1]["last_observation"], without_end(&frames.last().unwrap()["observation"]));
    // With `observations: none` only the observations are absent.
    ack(&api, "run", &ids(&groups)).await;
    let settings = json!({"policy": "random", "observations": "none", "max_unacknowledged_groups": 1});
    let _ = put_policy(&api, "run", settings).await.expect(200);
    let start = Instant::now();
    loop {
        let groups = claim(&api, "run", json!({"wait_s": 30})).await;
        groups.iter().for_each(assert_group_replays);
        ack(&api, "run", &ids(&groups)).await;
        if groups.iter().any(|group| group["observations"] == "none") {
            let text = serde_json::to_string(&groups).unwrap();
            assert!(!text.contains("\"observation\"") && !text.contains("last_observation"));
            break;
        }
        assert!(start.elapsed() < MAX_WAIT);
    }
}

/// Waits until the rollout worker has checked every run: it checks all of them before it rolls out a group of a new one.
async fn wait_for_worker_pass(api: &ApiClient) {
    create_run(api, "other", json!({})).await;
    let settings = json!({"policy": "hold", "max_unacknowledged_groups": 2});
    let _ = put_policy(api, "other", settings).await.expect(200);
    wait_for_full_feed(api, "other").await;
}

#[tokio::test]
async fn full_feed_stops_rollouts_until_groups_are_acknowledged() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let _ =
        put_policy(&api, "run", json!({"policy": "hold", "max_unacknowledged_groups": 3})).await.expect(200);
    let is_full_with = |groups: i64| {
        move |policy: &Value| policy["feed"]["full"] == true && number(&policy["groups"]) == groups
    };
    wait_for_policy(&api, "run", "the feed has 3 groups", is_full_with(3)).await;
    wait_for_worker_pass(&api).await;
    assert_eq!(number(&policy(&api, "run").await["groups"]), 3);
    let groups = claim(&api, "run", json!({"limit": 2})).await;
    assert_eq!(number(&policy(&api, "run").await["feed"]["delivered"]), 2);
    assert_eq!(
        number(&policy(&api, "run").await["groups"]),
        3,
        "a delivered group still counts towards the limit"
    );
    ack(&api, "run", &ids(&groups)).await;
    wait_for_policy(&api, "run", "the feed has 5 groups", is_full_with(5)).await;
    let leases = api.get("/v1/runs/run/leases").await.expect(200);
    assert_eq!(leases["leases"].as_array().unwrap().len(), 5, "no group is leased without room in the feed");
}

#[tokio::test]
async fn paused_run_has_no_rollouts_and_versions_only_rise() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let _ = api.post("/v1/runs/run/pause", json!({})).await.expect(200);
    let _ = put_policy(&api, "run", json!({"policy": "hold", "version": 4, "max_unacknowledged_groups": 2}))
        .await
        .expect(200);
    wait_for_worker_pass(&api).await;
    assert_eq!(number(&policy(&api, "run").await["groups"]), 0);
    let leases = api.get("/v1/runs/run/leases").await.expect(200);
    assert_eq!(leases["leases"], json!([]));
    let _ = api.post("/v1/runs/run/resume", json!({})).await.expect(200);
    wait_for_full_feed(&api, "run").await;
    let rejected = put_policy(&api, "run", json!({"policy": "hold", "version": 3})).await.expect(422);
    assert_eq!(rejected["field"], "version");
    assert_eq!(policy(&api, "run").await["version"], 4);
    // A request without a version keeps it; later groups have the new version.
    assert_eq!(
        put_policy(&api, "run", json!({"policy": "hold", "max_unacknowledged_groups": 2})).await.expect(200)
            ["version"],
        4
    );
    let _ =
        put_policy(&api, "run", json!({"policy": "frozen", "version": 9, "max_unacknowledged_groups": 4}))
            .await
            .expect(200);
    wait_for_full_feed(&api, "run").await;
    let groups = claim(&api, "run", json!({})).await;
    let versions: Vec<(&str, i64)> =
        groups.iter().map(|g| (g["policy"].as_str().unwrap(), number(&g["policy_version"]))).collect();
    assert_eq!(versions, [("hold", 4), ("hold", 4), ("frozen", 9), ("frozen", 9)]);
}
