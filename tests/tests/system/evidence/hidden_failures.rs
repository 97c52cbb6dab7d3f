//! Trainers that report the episodes they lose as failures of the infrastructure, or drop them in another way.

use serde_json::{Value, json};
use system_tests::ApiClient;

use super::{EvidenceServer, create_run, failed, hold_results, posterior_mean, task};

/// How a trainer hides the episodes that it loses.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Hiding {
    Fails,
    Releases,
    LetsExpire,
    ReportsAsOld,
}

/// Reports 64 scenarios with the policy that never acts, and hides those it loses. Returns the number of successes.
async fn report_hiding(api: &ApiClient, run: &str, hiding: Hiding) -> f64 {
    let ttl_s = if hiding == Hiding::LetsExpire { 1 } else { 600 };
    let lease = api.lease(run, json!({"groups": 64, "ttl_s": ttl_s, "policy_version": 9})).await;
    let mut results = hold_results(&lease);
    results.sort_by_key(|(_, won)| !won); // an old result is old only after the newest version
    let successes = results.iter().filter(|(_, won)| *won).count() as f64;
    let shown = |(result, won): (Value, bool)| match hiding {
        _ if won => Some(result),
        Hiding::Fails => Some(failed(result["episode"].as_str().unwrap())),
        Hiding::ReportsAsOld => {
            let mut result = result;
            result["policy_version"] = json!(1);
            Some(result)
        }
        Hiding::Releases | Hiding::LetsExpire => None,
    };
    api.report(run, results.into_iter().filter_map(shown).collect()).await;
    if hiding == Hiding::Releases {
        let _ =
            api.post(&format!("/v1/runs/{run}/leases/{}/release", lease.id()), json!({})).await.expect(200);
    }
    successes
}

#[tokio::test(flavor = "multi_thread")]
async fn hidden_failures_count_as_failures_wherever_mastery_is_shown() {
    let server = EvidenceServer::start();
    let api = server.api();
    for (run, hiding) in [
        ("fails", Hiding::Fails),
        ("releases", Hiding::Releases),
        ("expires", Hiding::LetsExpire),
        ("old", Hiding::ReportsAsOld),
    ] {
        create_run(&api, run, json!({"max_staleness": 2})).await;
        let successes = report_hiding(&api, run, hiding).await;
        let settled = system_tests::wait_for("all slots are settled", async || {
            let task = task(&api, run).await;
            (task["mastery"]["n"] == 64).then_some(task)
        });
        let task = settled.await;
        let (shown, wanted) = (&task["mastery"], posterior_mean(successes, 64.0));
        assert!((shown["mean"].as_f64().unwrap() - wanted).abs() < 1e-9, "{hiding:?}: {shown}, {wanted}");
        let missing = shown["missing"].as_f64().unwrap();
        assert!((missing - (64.0 - successes) / 64.0).abs() < 1e-9, "{hiding:?}: {shown}");
        assert!(task["warnings"][0].as_str().unwrap().contains("are missing"), "{hiding:?}: {task}");
        assert_eq!(task["level"], 0);
        if hiding != Hiding::ReportsAsOld {
            let plain = task["results"]["success"].as_f64().unwrap();
            assert!((plain - successes / 64.0).abs() < 1e-9, "{hiding:?}: {}", task["results"]);
        }
        let overview = api.get(&format!("/v1/runs/{run}/overview")).await.expect(200);
        assert_eq!(overview["tasks"][0]["mastery"], shown["mean"]);
        assert_eq!(overview["tasks"][0]["missing"], shown["missing"]);
        let metrics =
            system_tests::http_client().get(format!("{}/metrics", api.base())).send().await.unwrap();
        let metrics = metrics.text().await.unwrap();
        let gauge = |name: &str| -> f64 {
            let line =
                metrics.lines().find(|line| line.starts_with(name) && line.contains(&format!("\"{run}\"")));
            line.unwrap().rsplit(' ').next().unwrap().parse().unwrap()
        };
        assert!((gauge("sparring_mastery{") - wanted).abs() < 1e-9);
        assert!((gauge("sparring_missing_share{") - missing).abs() < 1e-9);
    }
}

/// A trainer that hides few failures, too: the worst case counts each of them.
#[tokio::test(flavor = "multi_thread")]
async fn few_hidden_failures_count_as_well() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let lease = api.lease("run", json!({"groups": 64})).await;
    let (mut hidden, mut successes) = (0, 0.0);
    let shown = hold_results(&lease).into_iter().map(|(result, won)| {
        successes += f64::from(u8::from(won));
        if !won && hidden < 5 {
            hidden += 1;
            return failed(result["episode"].as_str().unwrap());
        }
        result
    });
    let shown: Vec<Value> = shown.collect();
    api.report("run", shown).await;
    let task = task(&api, "run").await;
    let mean = task["mastery"]["mean"].as_f64().unwrap();
    assert!((mean - posterior_mean(successes, 64.0)).abs() < 1e-9, "{task}");
    assert!((task["mastery"]["missing"].as_f64().unwrap() - 5.0 / 64.0).abs() < 1e-9);
}

/// The scenario of a lost group is offered again, and its second attempt changes no slot.
#[tokio::test(flavor = "multi_thread")]
async fn second_attempt_at_a_scenario_is_no_evidence() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let first = api.lease("run", json!({"groups": 8})).await;
    let lost = first.episodes().iter().map(|(id, _)| failed(id)).collect();
    api.report("run", lost).await;
    let before = task(&api, "run").await["mastery"].clone();
    assert_eq!((&before["n"], &before["missing"]), (&json!(8), &json!(1.0)));
    let second = api.lease("run", json!({"groups": 8})).await;
    let scenarios = |lease: &system_tests::Lease| -> Vec<String> {
        let groups = lease.0["groups"].as_array().unwrap();
        groups.iter().map(|group| group["scenario"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(scenarios(&first), scenarios(&second), "the scenarios are offered again");
    api.report("run", second.results("hold")).await;
    assert_eq!(task(&api, "run").await["mastery"], before);
}
