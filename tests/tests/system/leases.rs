//! Leases: duplicate, foreign, late and partial results, expiry, release and renewal.

use std::sync::atomic::Ordering;

use clock::{Clock, ManualClock};
use serde_json::{Value, json};
use system_tests::{ApiClient, Server, episode_result, wait_for};

pub(crate) async fn create_run(api: &ApiClient, settings: Value) -> String {
    api.post("/v1/runs", settings).await.expect(201)["id"].as_str().unwrap().to_owned()
}

pub(crate) fn statuses(response: &Value) -> Vec<&str> {
    response["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect()
}

/// Waits until a lease has expired, and returns it.
async fn wait_for_expiry(api: &ApiClient, run: &str, lease: &str) -> Value {
    wait_for("the lease expires", async || {
        let shown = api.get(&format!("/v1/runs/{run}/leases/{lease}")).await.expect(200);
        (shown["status"] == "expired").then_some(shown)
    })
    .await
}

#[tokio::test]
async fn repeated_results_are_duplicates_with_own_receipts() {
    let server = Server::start().await;
    let api = server.api();
    let own = create_run(
        &api,
        json!({"strategy": "ladder", "id": "mine", "group_size": 2, "tasks": ["kessler/survival"]}),
    )
    .await;
    let other = create_run(&api, json!({"id": "other"})).await;
    let lease = api.lease(&own, json!({"groups": 2})).await;
    let foreign = api.lease(&other, json!({"groups": 1})).await;
    let results = lease.results("hold");

    let first = api.report(&own, results[..3].to_vec()).await;
    assert_eq!(statuses(&first), ["counted"; 3]);
    let before = api.get("/v1/runs/mine/mastery").await.expect(200);

    let mut batch = results.clone();
    let changed = lease.episodes()[1].clone();
    batch.push(episode_result(&changed.0, &changed.1, "blind"));
    batch.push(foreign.results("hold")[0].clone());
    let unknown = |id: &str| json!({"episode": id, "actions": {"steps": [], "stopped": "too_late"}});
    batch.push(unknown("ep_999-aaaaaa_0"));
    batch.push(unknown(&format!("ep_{}_4", lease.id())));
    batch.push(unknown("../../etc/passwd"));
    let repeated = api.report(&own, batch).await;
    assert_eq!(
        statuses(&repeated),
        [
            "duplicate",
            "duplicate",
            "duplicate",
            "counted",
            "refused",
            "refused",
            "refused",
            "refused",
            "refused"
        ]
    );
    let codes: Vec<_> =
        repeated["results"].as_array().unwrap()[4..].iter().map(|r| r["code"].as_str().unwrap()).collect();
    assert_eq!(codes, ["conflict", "foreign_episode", "unknown_episode", "unknown_episode", "bad_id"]);
    assert_eq!(
        repeated["results"][0]["score"], first["results"][0]["score"],
        "a duplicate has the same score"
    );

    let episodes = |v: &Value| v["tasks"][0]["results"]["episodes"].as_u64().unwrap();
    let after = api.get("/v1/runs/mine/mastery").await.expect(200);
    assert_eq!((episodes(&before), episodes(&after)), (3, 4), "nothing counts twice");
    // The same episode twice in one batch.
    let lease = api.lease(&own, json!({"groups": 1})).await;
    let twice = vec![lease.results("hold")[0].clone(), lease.results("hold")[0].clone()];
    assert_eq!(statuses(&api.report(&own, twice).await), ["counted", "duplicate"]);
}

/// Trainers that crash and retry may repeat results in any order and batch: every episode counts once.
#[tokio::test]
async fn concurrent_repeated_batches_count_each_episode_once() {
    let server = Server::start().await;
    let api = server.api();
    let id = create_run(&api, json!({"seed": 4, "group_size": 4, "tasks": ["kessler/survival"]})).await;
    let mut pool = Vec::new();
    for _ in 0..3 {
        pool.extend(api.lease(&id, json!({"groups": 6})).await.results("hold"));
    }
    let mut random = 12345u64;
    let mut below = |n: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as usize % n
    };
    let (mut counted, mut sent) = (0, std::collections::HashSet::new());
    for _ in 0..40 {
        let batch: Vec<Value> = (0..1 + below(9)).map(|_| pool[below(pool.len())].clone()).collect();
        sent.extend(batch.iter().map(|r| r["episode"].as_str().unwrap().to_owned()));
        let (a, b) = tokio::join!(api.report(&id, batch.clone()), api.report(&id, batch));
        counted += statuses(&a).into_iter().chain(statuses(&b)).filter(|w| *w == "counted").count();
    }
    assert_eq!(counted, sent.len());
    let task = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200)["tasks"][0].clone();
    assert_eq!(task["results"]["episodes"].as_u64(), Some(sent.len() as u64));
}

#[tokio::test]
async fn invalid_log_rejects_only_its_result() {
    let server = Server::start().await;
    let api = server.api();
    // With some seeds, the satellite that burns with all its fuel ends the fifth episode early.
    let settings =
        json!({"seed": 7, "tasks": ["kessler/survival"], "placement": false, "contested_share": 0.0});
    let id = create_run(&api, settings).await;
    let lease = api.lease(&id, json!({"groups": 12})).await;
    let names: Vec<String> = lease.episodes().into_iter().map(|(name, _)| name).collect();
    let empty = |n: usize| vec![json!([]); n];
    let with = |step: Value| {
        let mut steps = empty(50);
        steps[3] = step;
        json!({ "steps": steps })
    };
    let logs = [
        json!({"steps": empty(51)}),
        json!({"steps": empty(12)}),
        json!({"steps": empty(12), "stopped": "too_long"}),
        with(json!([[7, 0.1, 0.0]])),
        with(json!([[0, 1e308, -1e308]])),
        with(Value::Array(vec![json!([0, 0.001, 0.0]); 2000])),
        with(json!([[0, "NaN", 0.0]])),
        with(json!([[0, null, 0.0]])),
        with(json!([{"satellite_id": 0, "delta_vx": 0.1}])),
        with(json!({"burns": []})),
    ];
    let mut results: Vec<Value> =
        names.iter().zip(logs).map(|(n, log)| json!({"episode": n, "actions": log})).collect();
    results.push(json!({"episode": names[10]}));
    results.push(json!({"episode": names[11], "status": "failed", "actions": {"steps": []}}));
    let response = api.report(&id, results).await;
    let receipts: Vec<String> = response["results"]
        .as_array()
        .unwrap()
        .iter()
        .map(|r| match r["detail"].as_str() {
            Some(detail) => {
                format!("{} {}: {detail}", r["status"].as_str().unwrap(), r["code"].as_str().unwrap())
            }
            None => r["status"].as_str().unwrap().to_owned(),
        })
        .collect();
    insta::assert_debug_snapshot!(receipts);
    // A rejected episode can still be reported.
    let right = lease.episodes();
    let repeated = api.report(&id, vec![episode_result(&right[0].0, &right[0].1, "heuristic")]).await;
    assert_eq!(statuses(&repeated), ["counted"]);
}

#[tokio::test]
async fn late_results_are_stored_but_not_counted() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(1_800_000_000_000);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    let id = create_run(&api, json!({"seed": 5, "group_size": 4, "tasks": ["kessler/survival"]})).await;
    let lease = api.lease(&id, json!({"groups": 2, "ttl_s": 60})).await;
    let results = lease.results("hold");
    // Three of four results of the first group, one of the second.
    let partial: Vec<Value> = [0, 1, 2, 4].map(|i| results[i].clone()).to_vec();
    api.report(&id, partial).await;
    clock_ms.fetch_add(61_000, Ordering::SeqCst);
    let lease_after_expiry = wait_for_expiry(&api, &id, lease.id()).await;
    assert_eq!(
        lease_after_expiry["groups"][0]["state"], "partial",
        "a group with half of its results counts"
    );
    assert_eq!(lease_after_expiry["groups"][1]["state"], "lost");
    let before = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200);
    assert_eq!(before["tasks"][0]["results"]["expired"], 4);
    let late = api.report(&id, results).await;
    assert_eq!(
        statuses(&late),
        ["duplicate", "duplicate", "duplicate", "late", "duplicate", "late", "late", "late"]
    );
    let after = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200);
    assert_eq!(before, after);
    let episode = api.get(&format!("/v1/runs/{id}/episodes/{}", lease.episodes()[3].0)).await.expect(200);
    assert_eq!(episode["state"], "late");
    // The scenario of the lost group is offered first.
    let repeated = api.lease(&id, json!({"groups": 1})).await;
    assert_eq!(repeated.0["groups"][0]["scenario"], lease.0["groups"][1]["scenario"]);
    assert_ne!(repeated.id(), lease.id());
}

#[tokio::test]
async fn renewed_lease_can_be_released_once() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(1_800_000_000_000);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    let id = create_run(&api, json!({"seed": 5})).await;
    let lease = api.lease(&id, json!({"groups": 2, "ttl_s": 60})).await;
    let path = format!("/v1/runs/{id}/leases/{}", lease.id());
    for _ in 0..3 {
        clock_ms.fetch_add(50_000, Ordering::SeqCst);
        let _ = api.post(&format!("{path}/renew"), json!({})).await.expect(200);
    }
    assert_eq!(statuses(&api.report(&id, lease.results("hold")[..1].to_vec()).await), ["counted"]);
    assert_eq!(api.post(&format!("{path}/release"), json!({})).await.expect(200)["status"], "released");
    assert_eq!(api.post(&format!("{path}/release"), json!({})).await.expect(200)["status"], "released");
    let rejected = api.post(&format!("{path}/renew"), json!({})).await;
    assert_eq!((rejected.status, rejected.content_type.as_str()), (409, "application/problem+json"));
    let repeated = api.lease(&id, json!({"groups": 1})).await;
    assert_eq!(repeated.0["groups"][0]["scenario"], lease.0["groups"][1]["scenario"]);
    // A lease is found in its own run only.
    let other = create_run(&api, json!({})).await;
    assert_eq!(
        api.post(&format!("/v1/runs/{other}/leases/{}/renew", repeated.id()), json!({})).await.status,
        404
    );
}

#[tokio::test]
async fn large_lease_is_served_among_small_ones() {
    let server = Server::start().await;
    let api = server.api();
    let id = create_run(&api, json!({"seed": 8, "tasks": ["kessler/survival"], "placement": false})).await;
    let small = tokio::spawn({
        let (api, id) = (api.clone(), id.clone());
        async move {
            loop {
                let lease = api.lease(&id, json!({"groups": 4})).await;
                let path = format!("/v1/runs/{id}/leases/{}/release", lease.id());
                let _ = api.post(&path, json!({})).await;
            }
        }
    });
    let large = api.lease(&id, json!({"groups": 400})).await;
    small.abort();
    assert_eq!(large.episodes().len(), 400);
}

/// No scenario is solvable at these params: the search for contested ones ends, and other runs are served meanwhile.
#[tokio::test]
async fn unsolvable_level_does_not_block_other_runs() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"strategy": "ladder", "id": "hopeless", "tasks": ["kessler/rendezvous"], "placement": false, "contested_share": 1.0,
        "task_settings": {"kessler/rendezvous": {"levels": {"columns": ["debris", "fuel"], "rows": [[50, 0.5]]}}}});
    let hopeless = create_run(&api, settings).await;
    let healthy =
        create_run(&api, json!({"strategy": "ladder", "id": "healthy", "tasks": ["kessler/survival"]})).await;
    for _ in 0..3 {
        let lease = api.lease(&healthy, json!({"groups": 16})).await;
        assert_eq!(statuses(&api.report(&healthy, lease.results("hold")).await), ["counted"; 16]);
    }
    let lease = api.lease(&hopeless, json!({"groups": 1})).await;
    assert_eq!(
        lease.0["groups"][0]["contested"], false,
        "the group is not contested, because no scenario is"
    );
}

#[tokio::test]
async fn failed_episodes_count_as_missing() {
    let server = Server::start().await;
    let api = server.api();
    let id = create_run(
        &api,
        json!({"seed": 9, "strategy": "ladder", "placement": false, "tasks": ["kessler/survival"], "design": {"designer": "off"}}),
    )
    .await;
    for _ in 0..4 {
        let lease = api.lease(&id, json!({"groups": 32})).await;
        let results = lease
            .episodes()
            .iter()
            .enumerate()
            .map(|(i, (name, scenario))| match i % 3 {
                0 => json!({"episode": name, "status": "failed", "reason": "the worker was preempted"}),
                _ => episode_result(name, scenario, "heuristic"),
            })
            .collect();
        api.report(&id, results).await;
    }
    let task = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200)["tasks"][0].clone();
    assert!(task["results"]["failed"].as_u64().unwrap() > 30);
    let shown = &task["mastery"];
    assert!(shown["missing"].as_f64().unwrap() > 0.2 && shown["q90"].as_f64().unwrap() > 0.9, "{shown}");
    assert_eq!(task["level"], 0, "a third of the outcomes are missing");
    assert!(!task["warnings"].as_array().unwrap().is_empty(), "the run has a warning");
}

/// Scenarios that take seconds to plan do not delay other runs: their first lease request succeeds.
#[tokio::test]
async fn hard_run_does_not_delay_other_runs() {
    let server = Server::start().await;
    let api = server.api();
    let levels = json!({"columns": ["debris"], "rows": [[1000]]});
    let hard = json!({"kessler/formation": {"physics": {"risk": "pc"}, "levels": levels}});
    for id in ["hard", "harder"] {
        let settings =
            json!({"strategy": "ladder", "id": id, "tasks": ["kessler/formation"], "task_settings": hard});
        let _ = api.post("/v1/runs", settings).await.expect(201);
    }
    for (id, task) in [("easy", "kessler/survival"), ("other", "docking/single")] {
        let _ =
            api.post("/v1/runs", json!({"strategy": "ladder", "id": id, "tasks": [task]})).await.expect(201);
        let lease = api.post(&format!("/v1/runs/{id}/leases"), json!({"groups": 4})).await.expect(201);
        assert_eq!(lease["groups"].as_array().unwrap().len(), 4);
    }
    let hard = api.get("/v1/runs/hard").await.expect(200);
    assert_eq!(hard["status"], "active");
}

/// A result with an invalid field is rejected by that field; the other results of the batch count.
#[tokio::test]
async fn invalid_result_rejects_only_itself() {
    let server = Server::start().await;
    let api = server.api();
    let id = create_run(&api, json!({"tasks": ["kessler/survival"]})).await;
    let lease = api.lease(&id, json!({"groups": 4})).await;
    let mut results = lease.results("hold");
    results[0]["score"] = json!(1.0);
    results[1]["policy_version"] = json!(1e300);
    results[2]["actions"] = json!([]);
    let response = api.report(&id, results).await;
    assert_eq!(statuses(&response), ["refused", "refused", "refused", "counted"]);
    let receipts: Vec<String> = response["results"].as_array().unwrap()[..3]
        .iter()
        .map(|r| format!("{}: {}", r["code"].as_str().unwrap(), r["detail"].as_str().unwrap()))
        .collect();
    insta::assert_debug_snapshot!(receipts, @r#"
    [
        "invalid_result: score: is not a known field; the known fields are episode, status, actions, reason, policy_version, metrics",
        "invalid_result: policy_version: must be an integer from 0 to 4294967295, got 1e300",
        "invalid_result: actions: must be an object, got a list",
    ]
    "#);
}
