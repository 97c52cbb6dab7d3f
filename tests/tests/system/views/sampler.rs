//! Samplers of a run: where they draw, and the success there.

use std::sync::atomic::Ordering;

use clock::{Clock, ManualClock};
use serde_json::{Value, json};
use system_tests::{ApiClient, Server};

use super::{create_run, report_groups};

const MINUTE: i64 = 60_000;
/// Start of an hour, in milliseconds.
const START: i64 = 1_800_000_000_000;

/// Samplers of the run, with their course since its start in points of a minute.
async fn sampler(api: &ApiClient) -> Value {
    let start = jiff::Timestamp::from_millisecond(START).expect("a moment");
    api.get(&format!("/v1/runs/run/sampler?from={start}&points=7")).await.expect(200)
}

/// Reports all groups of a lease as flown by a policy.
async fn train(api: &ApiClient, groups: u32, policy: &str) {
    let lease = api.lease("run", json!({"groups": groups})).await;
    api.report("run", lease.results(policy)).await;
}

fn column(rungs: &Value, name: &str) -> Vec<f64> {
    let rungs = rungs.as_array().expect("a list of rungs");
    rungs.iter().map(|rung| rung[name].as_f64().unwrap_or_else(|| panic!("{name} of {rung}"))).collect()
}

fn sum(rungs: &Value, name: &str) -> f64 {
    column(rungs, name).iter().sum()
}

/// Checks that the mastery of the only task has the mean rung of the proposals that its sampler shows.
async fn assert_mean_rung(api: &ApiClient, sampler: &Value) {
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    let (rungs, shares) = (column(&sampler["rungs"], "rung"), column(&sampler["rungs"], "share"));
    let mean: f64 = rungs.iter().zip(shares).map(|(rung, share)| rung * share).sum();
    let shown = mastery["tasks"][0]["mean_rung"].as_f64().unwrap();
    assert!(mean > 0.0 && (shown - mean).abs() < 1e-9, "{shown} {mean}");
}

#[tokio::test(flavor = "multi_thread")]
async fn staircase_shows_chains_draws_and_success_by_start() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(START);
    let mut server = Server::with_clock(clock).await;
    let api = server.api();
    create_run(&api, json!({"strategy": "staircase", "tasks": ["docking/single"]})).await;
    let before = sampler(&api).await["tasks"][0].clone();
    assert_eq!((&before["at"], &before["quartiles"]), (&json!([]), &Value::Null));
    assert!(before["proposals"].as_u64() >= Some(8), "the queue is filled: {before}");
    assert_eq!(before["rungs"][0]["success"], Value::Null);
    assert_eq!(sum(&before["rungs"], "chains"), 32.0);
    for groups in [96, 64] {
        train(&api, groups, "heuristic").await;
        clock_ms.fetch_add(3 * MINUTE, Ordering::SeqCst);
    }
    let body = sampler(&api).await;
    assert_mean_rung(&api, &body["tasks"][0]).await;
    assert_eq!((&body["strategy"], &body["resolution"]), (&json!("staircase"), &json!("minutes")));
    let task = &body["tasks"][0];
    assert_eq!(
        (&task["name"], &task["kind"], &task["reason"]),
        (&json!("staircase"), &json!("start"), &Value::Null)
    );
    assert!(task["state"].as_str().unwrap().contains("of the 32 chains"), "{task}");
    let rungs = &task["rungs"];
    let scales = column(rungs, "start_scale");
    assert!(scales.len() == 16 && scales.is_sorted() && scales[15] == 1.0, "{scales:?}");
    assert_eq!((sum(rungs, "chains"), sum(rungs, "draws")), (32.0, task["proposals"].as_f64().unwrap()));
    assert!((sum(rungs, "probability") - 1.0).abs() < 1e-9 && (sum(rungs, "share") - 1.0).abs() < 1e-9);
    assert_eq!(task["proposals"], 160 + 64);
    // The heuristic succeeds from near starts, so that chains climb.
    assert!(rungs[0]["chains"].as_u64() < Some(32) && task["quartiles"].is_array(), "{task}");
    assert!(rungs[0]["success"].as_f64() > Some(0.5), "{task}");
    // The course has every group in the minute of its results.
    assert_eq!(task["at"], json!([START as f64 / 1000.0, START as f64 / 1000.0 + 180.0]));
    let groups_at = |point: usize| {
        let rungs = rungs.as_array().unwrap().iter();
        rungs.map(|rung| rung["groups"][point].as_i64().unwrap()).sum::<i64>()
    };
    assert_eq!([groups_at(0), groups_at(1)], [96, 64]);
    assert!(rungs[0]["group_success"][0].as_f64() > Some(0.5), "{task}");
    assert_eq!(rungs[15]["group_success"].as_array().map(Vec::len), Some(2));
    server.restart().await;
    assert_eq!(sampler(&server.api()).await, body, "a restart changes nothing");
}

/// Draws and successes of levels outlast a change of the strategy; strategies that draw params have no rungs.
#[tokio::test(flavor = "multi_thread")]
async fn rungs_follow_the_strategy() {
    let ManualClock { clock, .. } = Clock::manual(START);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    create_run(&api, json!({"strategy": "bandit"})).await;
    train(&api, 64, "heuristic").await;
    let bandit = sampler(&api).await["tasks"][0].clone();
    assert_eq!((&bandit["kind"], &bandit["rungs"][3]["chains"]), (&json!("level"), &Value::Null));
    let _ = api.send_json("PATCH", "/v1/runs/run", json!({"strategy": "ladder"})).await.expect(200);
    let ladder = sampler(&api).await["tasks"][0].clone();
    assert_eq!((&ladder["name"], &ladder["rungs"][0]["probability"]), (&json!("ladder"), &Value::Null));
    assert_eq!(column(&ladder["rungs"], "attempts"), column(&bandit["rungs"], "attempts"));
    assert_eq!(ladder["at"], bandit["at"]);
    let _ = api.send_json("PATCH", "/v1/runs/run", json!({"strategy": "fixed"})).await.expect(200);
    let fixed = sampler(&api).await["tasks"][0].clone();
    assert_eq!((&fixed["kind"], &fixed["rungs"], &fixed["at"]), (&Value::Null, &json!([]), &json!([])));
    assert_eq!(fixed["state"], "at its default params");
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!(mastery["tasks"][0]["mean_rung"], Value::Null);
}

#[tokio::test(flavor = "multi_thread")]
async fn sampler_of_auto_matches_snapshot() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(START);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    let two_levels = json!({"levels": {"columns": ["debris"], "rows": [[10], [40]]}});
    let tasks = ["kessler/survival", "kessler/rendezvous"];
    let task_settings = json!({tasks[0]: two_levels, tasks[1]: two_levels});
    create_run(&api, json!({"strategy": "auto", "tasks": tasks, "task_settings": task_settings})).await;
    report_groups(&api, 24, "heuristic").await;
    clock_ms.fetch_add(MINUTE, Ordering::SeqCst);
    insta::assert_json_snapshot!("auto", sampler(&api).await);
}
