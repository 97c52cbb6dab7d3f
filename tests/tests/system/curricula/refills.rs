//! Refills: groups whose episodes all have the same score are replaced by further groups.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use system_tests::{ApiClient, Lease, Server, episode_result, wait_for};

use super::{SURVIVAL, groups};

#[tokio::test(flavor = "multi_thread")]
async fn zero_variance_groups_are_refilled_once() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"strategy": "ladder", "id": "run", "seed": 4, "tasks": [SURVIVAL], "group_size": 2, "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let leased = api.lease("run", json!({"groups": 4, "refill": true})).await;
    let path = format!("/v1/runs/run/leases/{}", leased.id());
    // A deterministic policy gives both episodes of a group the same score.
    let same = |lease: &Lease, from: usize| -> Vec<Value> {
        lease.episodes()[2 * from..]
            .iter()
            .map(|(id, scenario)| episode_result(id, scenario, "hold"))
            .collect()
    };
    let report = api.report("run", same(&leased, 0)).await;
    let groups_done = report["groups"].as_array().unwrap();
    assert_eq!(groups_done.len(), 4);
    for group in groups_done {
        assert_eq!(
            (&group["state"], &group["finished"], &group["zero_variance"]),
            (&json!("complete"), &json!(2), &json!(true))
        );
    }
    let refilled = wait_for("four groups are added", async || {
        let response = api.get(&path).await.expect(200);
        (response["groups"].as_array().unwrap().len() == 8).then_some(Lease(response))
    });
    let refilled = refilled.await;
    assert_eq!(refilled.0["status"], "active");
    let scenarios: BTreeSet<String> =
        groups(&refilled).iter().map(|g| g["scenario"].as_str().unwrap().to_owned()).collect();
    assert_eq!(scenarios.len(), 8);
    // The added groups have no variance either; a lease is refilled up to twice its size only.
    let report = api.report("run", same(&refilled, 4)).await;
    assert_eq!(
        (report["groups"].as_array().unwrap().len(), report["refills"].as_array().unwrap().len()),
        (4, 0)
    );
    let done = api.get(&path).await.expect(200);
    assert_eq!((&done["status"], done["groups"].as_array().unwrap().len()), (&json!("done"), 8));
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    let counted = &mastery["tasks"][0]["group_counts"];
    assert_eq!(
        (&counted["complete"], &counted["zero_variance"], &counted["zero_variance_share"]),
        (&json!(8), &json!(8), &json!(1.0))
    );
}

/// Siblings whose first burns differ by `step` LU/TU each, in one group of eight.
async fn report_siblings(api: &ApiClient, run: &str, step: f64) -> Value {
    let settings = json!({"strategy": "ladder", "id": run, "seed": 1, "tasks": ["kessler/eco_station"], "group_size": 8, "placement": false,
        "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let lease = api.lease(run, json!({"groups": 1, "refill": true})).await;
    let results = lease.episodes().into_iter().enumerate().map(|(at, (id, scenario))| {
        let mut result = episode_result(&id, &scenario, "hold");
        result["actions"]["steps"][0] = json!([[0, 0.01 + step * at as f64, 0.0]]);
        result
    });
    api.report(run, results.collect()).await["groups"][0].clone()
}

#[tokio::test(flavor = "multi_thread")]
async fn float_noise_is_no_variance() {
    let server = Server::start().await;
    let api = server.api();
    let noise = report_siblings(&api, "noise", 1e-9).await;
    assert_eq!((&noise["finished"], &noise["zero_variance"]), (&json!(8), &json!(true)), "{noise}");
    let differs = report_siblings(&api, "differs", 0.02).await;
    assert_eq!((&differs["finished"], &differs["zero_variance"]), (&json!(8), &json!(false)), "{differs}");
    // The group is replaced, as one with equal scores.
    let mastery = api.get("/v1/runs/noise/mastery").await.expect(200);
    assert_eq!(mastery["tasks"][0]["group_counts"]["zero_variance"], 1);
    wait_for("a group is added", async || {
        let leases = api.get("/v1/runs/noise/leases").await.expect(200);
        (leases["leases"][0]["groups"] == 2).then_some(())
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn groups_with_variance_are_not_refilled() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"strategy": "ladder", "id": "run", "seed": 4, "tasks": [SURVIVAL], "group_size": 4, "min_group": 2, "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let leased = api.lease("run", json!({"groups": 2, "refill": true})).await;
    let episodes = leased.episodes();
    // One episode of the first group fails, so that the group is partial and counts.
    let mut results: Vec<Value> = Vec::new();
    for (at, (id, scenario)) in episodes.iter().enumerate() {
        results.push(match at {
            0 => json!({"episode": id, "status": "failed", "reason": "the node was lost"}),
            _ if at % 2 == 0 => episode_result(id, scenario, "hold"),
            _ => episode_result(id, scenario, "random"),
        });
    }
    let report = api.report("run", results).await;
    let groups_done = report["groups"].as_array().unwrap();
    let partial = groups_done.iter().find(|group| group["group"] == 0).unwrap();
    assert_eq!((&partial["state"], &partial["failed"]), (&json!("partial"), &json!(1)), "{groups_done:?}");
    let differs = groups_done.iter().filter(|group| group["zero_variance"] == false).count();
    let response = api.get(&format!("/v1/runs/run/leases/{}", leased.id())).await.expect(200);
    let refilled = response["groups"].as_array().unwrap().len() - 2;
    assert!(refilled <= 2 - differs, "{refilled} groups were added although {differs} have variance");
    for (settings, text) in [
        (json!({"groups": 1, "group_size": 1, "refill": true}), "at least 2"),
        (json!({"groups": 1, "purpose": "eval", "refill": true}), "purpose: train"),
        (json!({"groups": 100, "form": "columns", "refill": true}), "results per group"),
    ] {
        let problem = api.post("/v1/runs/run/leases", settings).await.expect(422);
        assert!(problem["detail"].as_str().unwrap().contains(text), "{problem}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn feed_with_refill_has_no_zero_variance_groups() {
    let server = Server::start().await;
    let api = server.api();
    let mut wanted = 60; // the first run raises it until a group without variance was seen
    for (run, refill) in [("all", false), ("some", true)] {
        let settings = json!({"strategy": "ladder", "id": run, "seed": 4, "tasks": [SURVIVAL], "group_size": 2, "design": {"designer": "off"}});
        let _ = api.post("/v1/runs", settings).await.expect(201);
        let policy = json!({"policy": "random", "refill": refill, "max_unacknowledged_groups": 24});
        let _ = api.send_json("PUT", &format!("/v1/runs/{run}/policy"), policy).await.expect(200);
        let mut zero_variance = 0;
        let mut pulled = 0;
        for _ in 0..300 {
            let page = api
                .post(&format!("/v1/runs/{run}/trajectories/claim"), json!({"limit": 8, "wait_s": 2}))
                .await
                .expect(200);
            let groups = page["groups"].as_array().unwrap().clone();
            let ids: Vec<Value> = groups.iter().map(|group| group["id"].clone()).collect();
            for group in &groups {
                let scores: Vec<f64> = group["episodes"]
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|e| e["score"].as_f64().unwrap())
                    .collect();
                zero_variance += usize::from(scores.windows(2).all(|two| two[0] == two[1]));
            }
            pulled += groups.len();
            let _ =
                api.post(&format!("/v1/runs/{run}/trajectories/ack"), json!({"ids": ids})).await.expect(200);
            if pulled >= wanted && (refill || zero_variance > 0) {
                break;
            }
        }
        assert!(pulled >= wanted, "{run}: {pulled}");
        wanted = pulled;
        assert_eq!(zero_variance > 0, !refill, "{run}: {zero_variance} of {pulled} have no variance");
    }
}
