//! A lease's life: reported twice, by strangers, late, in part, released, renewed.

use std::sync::atomic::Ordering;
use std::time::Duration;

use orchestrator::clock::Clock;
use serde_json::{Value, json};
use system_tests::{Api, Lease, Server, result};

async fn run(api: &Api, wish: Value) -> String {
    api.post("/v1/runs", wish).await.expect(201)["id"].as_str().unwrap().to_owned()
}

fn held(lease: &Lease) -> Vec<Value> {
    lease.episodes().iter().map(|(id, scenario)| result(id, scenario, "hold")).collect()
}

fn words(answer: &Value) -> Vec<&str> {
    answer["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect()
}

/// Waits until a lease has this status.
async fn becomes(api: &Api, run: &str, lease: &str, status: &str) -> Value {
    for _ in 0..200 {
        let shown = api.get(&format!("/v1/runs/{run}/leases/{lease}")).await.expect(200);
        if shown["status"] == status {
            return shown;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("lease {lease} did not become {status}");
}

#[tokio::test]
async fn reporting_is_idempotent_and_each_result_gets_its_own_answer() {
    let server = Server::start().await;
    let api = server.api();
    let mine = run(&api, json!({"id": "mine", "group_size": 2, "tasks": ["kessler/survival"]})).await;
    let other = run(&api, json!({"id": "other"})).await;
    let lease = api.lease(&mine, json!({"groups": 2})).await;
    let foreign = api.lease(&other, json!({"groups": 1})).await;
    let results = held(&lease);

    let first = api.report(&mine, results[..3].to_vec()).await;
    assert_eq!(words(&first), ["counted"; 3]);
    let before = api.get("/v1/runs/mine/mastery").await.expect(200);

    let mut batch = results.clone();
    let changed = lease.episodes()[1].clone();
    batch.push(result(&changed.0, &changed.1, "blind"));
    batch.push(held(&foreign)[0].clone());
    let unknown = |id: &str| json!({"episode": id, "actions": {"steps": [], "stopped": "too_late"}});
    batch.push(unknown("ep_999-aaaaaa_0"));
    batch.push(unknown(&format!("ep_{}_4", lease.id())));
    batch.push(unknown("../../etc/passwd"));
    let again = api.report(&mine, batch).await;
    assert_eq!(
        words(&again),
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
        again["results"].as_array().unwrap()[4..].iter().map(|r| r["code"].as_str().unwrap()).collect();
    assert_eq!(codes, ["conflict", "foreign_episode", "unknown_episode", "unknown_episode", "bad_id"]);
    assert_eq!(again["results"][0]["score"], first["results"][0]["score"], "answered as before");

    let episodes = |v: &Value| v["tasks"][0]["plain"]["episodes"].as_u64().unwrap();
    let after = api.get("/v1/runs/mine/mastery").await.expect(200);
    assert_eq!((episodes(&before), episodes(&after)), (3, 4), "nothing counts twice");
    // The same episode twice in one batch.
    let lease = api.lease(&mine, json!({"groups": 1})).await;
    let twice = vec![held(&lease)[0].clone(), held(&lease)[0].clone()];
    assert_eq!(words(&api.report(&mine, twice).await), ["counted", "duplicate"]);
}

/// Trainers that crash and retry send anything twice, in any order and company: every episode counts once.
#[tokio::test]
async fn whatever_is_sent_again_counts_once() {
    let server = Server::start().await;
    let api = server.api();
    let id = run(&api, json!({"seed": 4, "group_size": 4, "tasks": ["kessler/survival"]})).await;
    let mut pool = Vec::new();
    for _ in 0..3 {
        pool.extend(held(&api.lease(&id, json!({"groups": 6})).await));
    }
    let mut draw = 12345u64;
    let mut below = |n: usize| {
        draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (draw >> 33) as usize % n
    };
    let (mut counted, mut sent) = (0, std::collections::HashSet::new());
    for _ in 0..40 {
        let batch: Vec<Value> = (0..1 + below(9)).map(|_| pool[below(pool.len())].clone()).collect();
        sent.extend(batch.iter().map(|r| r["episode"].as_str().unwrap().to_owned()));
        let (a, b) = tokio::join!(api.report(&id, batch.clone()), api.report(&id, batch));
        counted += words(&a).into_iter().chain(words(&b)).filter(|w| *w == "counted").count();
    }
    assert_eq!(counted, sent.len());
    let task = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200)["tasks"][0].clone();
    assert_eq!(task["plain"]["episodes"].as_u64(), Some(sent.len() as u64));
}

#[tokio::test]
async fn wrong_logs_are_refused_by_themselves() {
    let server = Server::start().await;
    let api = server.api();
    let id =
        run(&api, json!({"tasks": ["kessler/survival"], "placement": false, "contested_share": 0.0})).await;
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
    let answer = api.report(&id, results).await;
    let told: Vec<String> = answer["results"]
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
    insta::assert_debug_snapshot!(told);
    // What was refused can be reported still.
    let right = lease.episodes();
    let again = api.report(&id, vec![result(&right[0].0, &right[0].1, "heuristic")]).await;
    assert_eq!(words(&again), ["counted"]);
}

#[tokio::test]
async fn what_comes_after_expiry_is_late_and_moves_nothing() {
    let (clock, hand) = Clock::manual(1_800_000_000_000);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    let id = run(&api, json!({"seed": 5, "group_size": 4, "tasks": ["kessler/survival"]})).await;
    let lease = api.lease(&id, json!({"groups": 2, "ttl_s": 60})).await;
    let results = held(&lease);
    // Three of the first group's four come back, one of the second's.
    let partial: Vec<Value> = [0, 1, 2, 4].map(|i| results[i].clone()).to_vec();
    api.report(&id, partial).await;
    hand.fetch_add(61_000, Ordering::SeqCst);
    let shown = becomes(&api, &id, lease.id(), "expired").await;
    assert_eq!(shown["groups"][0]["state"], "partial", "from half of the group on it counts");
    assert_eq!(shown["groups"][1]["state"], "lost");
    let before = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200);
    assert_eq!(before["tasks"][0]["plain"]["expired"], 4);
    let late = api.report(&id, results).await;
    assert_eq!(
        words(&late),
        ["duplicate", "duplicate", "duplicate", "late", "duplicate", "late", "late", "late"]
    );
    let after = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200);
    assert_eq!(before, after);
    let episode = api.get(&format!("/v1/runs/{id}/episodes/{}", lease.episodes()[3].0)).await.expect(200);
    assert_eq!(episode["state"], "late");
    // The lost group's scenario is offered again, first of all.
    let again = api.lease(&id, json!({"groups": 1})).await;
    assert_eq!(again.0["groups"][0]["scenario"], lease.0["groups"][1]["scenario"]);
    assert_ne!(again.id(), lease.id());
}

#[tokio::test]
async fn leases_are_renewed_and_released() {
    let (clock, hand) = Clock::manual(1_800_000_000_000);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    let id = run(&api, json!({"seed": 5})).await;
    let lease = api.lease(&id, json!({"groups": 2, "ttl_s": 60})).await;
    let path = format!("/v1/runs/{id}/leases/{}", lease.id());
    for _ in 0..3 {
        hand.fetch_add(50_000, Ordering::SeqCst);
        let _ = api.post(&format!("{path}/renew"), json!({})).await.expect(200);
    }
    assert_eq!(words(&api.report(&id, held(&lease)[..1].to_vec()).await), ["counted"]);
    assert_eq!(api.post(&format!("{path}/release"), json!({})).await.expect(200)["status"], "released");
    assert_eq!(api.post(&format!("{path}/release"), json!({})).await.expect(200)["status"], "released");
    let over = api.post(&format!("{path}/renew"), json!({})).await;
    assert_eq!((over.status, over.kind.as_str()), (409, "application/problem+json"));
    let again = api.lease(&id, json!({"groups": 1})).await;
    assert_eq!(again.0["groups"][0]["scenario"], lease.0["groups"][1]["scenario"]);
    // A lease of another run is not found, whoever knows its name.
    let other = run(&api, json!({})).await;
    assert_eq!(
        api.post(&format!("/v1/runs/{other}/leases/{}/renew", again.id()), json!({})).await.status,
        404
    );
}

#[tokio::test]
async fn a_large_lease_gets_its_turn_among_small_ones() {
    let server = Server::start().await;
    let api = server.api();
    let id = run(&api, json!({"seed": 8, "tasks": ["kessler/survival"], "placement": false})).await;
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

/// Nothing can be won at these params: what nobody could do is not looked for for ever, and others go on meanwhile.
#[tokio::test]
async fn a_hopeless_table_holds_up_nobody() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"id": "hopeless", "tasks": ["kessler/rendezvous"], "placement": false, "contested_share": 1.0,
        "task_settings": {"kessler/rendezvous": {"levels": {"columns": ["debris", "fuel"], "rows": [[50, 0.5]]}}}});
    let hopeless = run(&api, wish).await;
    let healthy = run(&api, json!({"id": "healthy", "tasks": ["kessler/survival"]})).await;
    for _ in 0..3 {
        let lease = api.lease(&healthy, json!({"groups": 16})).await;
        assert_eq!(words(&api.report(&healthy, held(&lease)).await), ["counted"; 16]);
    }
    let lease = api.lease(&hopeless, json!({"groups": 1})).await;
    assert_eq!(lease.0["groups"][0]["contested"], false, "as it comes, since nothing else is to be had");
}

#[tokio::test]
async fn failed_episodes_are_never_low_scores() {
    let server = Server::start().await;
    let api = server.api();
    let id = run(
        &api,
        json!({"seed": 9, "placement": false, "tasks": ["kessler/survival"], "design": {"designer": "off"}}),
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
                _ => result(name, scenario, "heuristic"),
            })
            .collect();
        api.report(&id, results).await;
    }
    let task = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200)["tasks"][0].clone();
    assert!(task["plain"]["failed"].as_u64().unwrap() > 30);
    assert!(task["mastery"]["mean"].as_f64().unwrap() > 0.9, "{}", task["mastery"]);
    assert_eq!(task["level"], 0, "a third lost: no block counts");
    assert!(!task["warnings"].as_array().unwrap().is_empty(), "and the run says so");
}

#[tokio::test]
async fn evaluation_moves_nothing_and_old_policies_are_stale() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"seed": 9, "tasks": ["kessler/survival"], "max_staleness": 2});
    let id = run(&api, wish).await;
    let lease = api.lease(&id, json!({"groups": 4, "purpose": "eval"})).await;
    for group in lease.0["groups"].as_array().unwrap() {
        assert_eq!(group["seed"].as_u64().unwrap() >> 51, 0b10, "evaluation seeds");
    }
    assert_eq!(words(&api.report(&id, held(&lease)).await), ["stored"; 4]);
    let mastery = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200);
    assert_eq!(mastery["tasks"][0]["plain"]["episodes"], 0);

    let lease = api.lease(&id, json!({"groups": 4, "policy_version": 5})).await;
    for group in lease.0["groups"].as_array().unwrap() {
        assert_eq!(group["seed"].as_u64().unwrap() >> 51, 0b01, "training seeds");
    }
    let results = held(&lease);
    let path = format!("/v1/runs/{id}/results");
    let fresh = api.post(&path, json!({"policy_version": 9, "results": [results[0]]})).await.expect(200);
    assert_eq!(words(&fresh), ["counted"]);
    let stale = api.post(&path, json!({"policy_version": 6, "results": [results[1]]})).await.expect(200);
    assert_eq!(words(&stale), ["stored"]);
    let near = api.post(&path, json!({"policy_version": 7, "results": [results[2]]})).await.expect(200);
    assert_eq!(words(&near), ["counted"]);
}

#[tokio::test]
async fn a_policy_version_named_by_mistake_is_set_back() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"seed": 9, "tasks": ["kessler/survival"], "max_staleness": 2});
    let id = run(&api, wish).await;
    let lease = api.lease(&id, json!({"groups": 3, "policy_version": 5})).await;
    let (results, path) = (held(&lease), format!("/v1/runs/{id}/results"));
    let wrong = json!({"policy_version": 4_000_000_000_u32, "results": [results[0]]});
    assert_eq!(words(&api.post(&path, wrong).await.expect(200)), ["counted"]);
    assert_eq!(words(&api.post(&path, json!({"results": [results[1]]})).await.expect(200)), ["stored"]);

    let newest = format!("/v1/runs/{id}/policy_version");
    let set = api.raw("PUT", &newest, "application/json", json!({"policy_version": 5}).to_string()).await;
    assert_eq!((set.status, &set.body["policy_version"]), (200, &json!(5)));
    assert_eq!(words(&api.post(&path, json!({"results": [results[2]]})).await.expect(200)), ["counted"]);
    for (wish, field) in [(json!({}), "policy_version"), (json!({"policy_version": -1}), "policy_version")] {
        let refused = api.raw("PUT", &newest, "application/json", wish.to_string()).await;
        assert_eq!((refused.status, &refused.body["field"]), (422, &json!(field)));
    }
    let nowhere = "/v1/runs/nowhere/policy_version";
    let unknown = api.raw("PUT", nowhere, "application/json", json!({"policy_version": 5}).to_string()).await;
    assert_eq!(unknown.status, 404);
}

#[tokio::test]
async fn where_probes_are_the_evidence_training_moves_nothing() {
    let server = Server::start().await;
    let api = server.api();
    let id = run(&api, json!({"seed": 2, "evidence_from": "probe", "tasks": ["kessler/survival"]})).await;
    let train = api.lease(&id, json!({"groups": 2})).await;
    assert_eq!(words(&api.report(&id, held(&train)).await), ["stored"; 2]);
    let probe = api.lease(&id, json!({"groups": 2, "purpose": "probe"})).await;
    assert_eq!(words(&api.report(&id, held(&probe)).await), ["counted"; 2]);
}

/// Scenarios that take seconds to plan keep no other run waiting: its lease is served at the first try.
#[tokio::test]
async fn a_run_that_is_hard_to_prepare_starves_nobody() {
    let server = Server::start().await;
    let api = server.api();
    let levels = json!({"columns": ["debris"], "rows": [[1000]]});
    let hard = json!({"kessler/formation": {"physics": {"risk": "pc"}, "levels": levels}});
    for id in ["hard", "harder"] {
        let wish = json!({"id": id, "tasks": ["kessler/formation"], "task_settings": hard});
        let _ = api.post("/v1/runs", wish).await.expect(201);
    }
    for (id, task) in [("easy", "kessler/survival"), ("other", "docking/single")] {
        let _ = api.post("/v1/runs", json!({"id": id, "tasks": [task]})).await.expect(201);
        let lease = api.post(&format!("/v1/runs/{id}/leases"), json!({"groups": 4})).await.expect(201);
        assert_eq!(lease["groups"].as_array().unwrap().len(), 4);
    }
    let hard = api.get("/v1/runs/hard").await.expect(200);
    assert_eq!(hard["status"], "active");
}

/// A result whose fields are wrong is refused by itself, by its field; its neighbours count.
#[tokio::test]
async fn a_misshapen_result_is_refused_alone() {
    let server = Server::start().await;
    let api = server.api();
    let run = run(&api, json!({"tasks": ["kessler/survival"]})).await;
    let lease = api.lease(&run, json!({"groups": 4})).await;
    let mut results = held(&lease);
    results[0]["score"] = json!(1.0);
    results[1]["policy_version"] = json!(1e300);
    results[2]["actions"] = json!([]);
    let answer = api.report(&run, results).await;
    assert_eq!(words(&answer), ["refused", "refused", "refused", "counted"]);
    let told: Vec<String> = answer["results"].as_array().unwrap()[..3]
        .iter()
        .map(|r| format!("{}: {}", r["code"].as_str().unwrap(), r["detail"].as_str().unwrap()))
        .collect();
    insta::assert_debug_snapshot!(told, @r#"
    [
        "invalid_result: score: it is not a known field; known are episode, status, actions, reason, policy_version, metrics",
        "invalid_result: policy_version: it is 1e300, but must be a whole number from 0 to 4294967295",
        "invalid_result: actions: it is a list, but must be an object",
    ]
    "#);
}
