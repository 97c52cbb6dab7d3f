//! Groups whose episodes all have the same score, and others in their place.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::{Value, json};
use system_tests::{Lease, Server, result};

use super::{SURVIVAL, groups, lease};

#[tokio::test(flavor = "multi_thread")]
async fn groups_that_say_nothing_are_replaced() {
    let server = Server::start().await;
    let api = server.api();
    let wish =
        json!({"id": "run", "seed": 4, "tasks": [SURVIVAL], "group_size": 2, "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let taken = lease(&api, "run", json!({"groups": 4, "refill": true})).await;
    let path = format!("/v1/runs/run/leases/{}", taken.id());
    // Both episodes of every group alike: a policy without chance.
    let same = |lease: &Lease, from: usize| -> Vec<Value> {
        lease.episodes()[2 * from..].iter().map(|(id, scenario)| result(id, scenario, "hold")).collect()
    };
    let told = api.report("run", same(&taken, 0)).await;
    let ends = told["groups"].as_array().unwrap();
    assert_eq!(ends.len(), 4);
    for end in ends {
        assert_eq!(
            (&end["state"], &end["finished"], &end["zero_variance"]),
            (&json!("complete"), &json!(2), &json!(true))
        );
    }
    let mut shown = Value::Null;
    for _ in 0..100 {
        shown = api.get(&path).await.expect(200);
        if shown["groups"].as_array().unwrap().len() == 8 {
            break;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let refilled = Lease(shown);
    assert_eq!(groups(&refilled).len(), 8, "as many again: {}", told["refills"]);
    assert_eq!(refilled.0["status"], "active");
    let scenarios: BTreeSet<String> =
        groups(&refilled).iter().map(|g| g["scenario"].as_str().unwrap().to_owned()).collect();
    assert_eq!(scenarios.len(), 8);
    // These too come to the same: no more are given than were asked for.
    let told = api.report("run", same(&refilled, 4)).await;
    assert_eq!((told["groups"].as_array().unwrap().len(), told["refills"].as_array().unwrap().len()), (4, 0));
    let done = api.get(&path).await.expect(200);
    assert_eq!((&done["status"], done["groups"].as_array().unwrap().len()), (&json!("done"), 8));
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    let counted = &mastery["tasks"][0]["groups"];
    assert_eq!(
        (&counted["complete"], &counted["zero_variance"], &counted["zero_variance_share"]),
        (&json!(8), &json!(8), &json!(1.0))
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn groups_that_differ_are_not() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"id": "run", "seed": 4, "tasks": [SURVIVAL], "group_size": 4, "min_group": 2, "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let taken = lease(&api, "run", json!({"groups": 2, "refill": true})).await;
    let episodes = taken.episodes();
    // Of the first group one is lost; what differs does, and what is left is partial and counts.
    let mut results: Vec<Value> = Vec::new();
    for (at, (id, scenario)) in episodes.iter().enumerate() {
        results.push(match at {
            0 => json!({"episode": id, "status": "failed", "reason": "the node went away"}),
            _ if at % 2 == 0 => result(id, scenario, "hold"),
            _ => result(id, scenario, "random"),
        });
    }
    let told = api.report("run", results).await;
    let ends = told["groups"].as_array().unwrap();
    let partial = ends.iter().find(|end| end["group"] == 0).unwrap();
    assert_eq!((&partial["state"], &partial["failed"]), (&json!("partial"), &json!(1)), "{ends:?}");
    let differs = ends.iter().filter(|end| end["zero_variance"] == false).count();
    let shown = api.get(&format!("/v1/runs/run/leases/{}", taken.id())).await.expect(200);
    let given = shown["groups"].as_array().unwrap().len() - 2;
    assert!(given <= 2 - differs, "{given} were given though {differs} differ");
    for (wish, words) in [
        (json!({"groups": 1, "group_size": 1, "refill": true}), "two or more"),
        (json!({"groups": 1, "purpose": "eval", "refill": true}), "for training"),
        (json!({"groups": 100, "form": "columns", "refill": true}), "columns"),
    ] {
        let problem = api.post("/v1/runs/run/leases", wish).await.expect(422);
        assert!(problem["detail"].as_str().unwrap().contains(words), "{problem}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_feed_keeps_them_out() {
    let server = Server::start().await;
    let api = server.api();
    let mut enough = 60; // and as many as it takes without refills until one says nothing
    for (run, refill) in [("all", false), ("some", true)] {
        let wish = json!({"id": run, "seed": 4, "tasks": [SURVIVAL], "group_size": 2, "design": {"designer": "off"}});
        let _ = api.post("/v1/runs", wish).await.expect(201);
        let policy = json!({"policy": "random", "refill": refill, "ahead": 24});
        let _ = api.send("PUT", &format!("/v1/runs/{run}/policy"), policy).await.expect(200);
        let mut flat = 0;
        let mut pulled = 0;
        for _ in 0..300 {
            let page = api.get(&format!("/v1/runs/{run}/trajectories?limit=8&wait_s=2")).await.expect(200);
            let groups = page["groups"].as_array().unwrap().clone();
            let ids: Vec<Value> = groups.iter().map(|group| group["id"].clone()).collect();
            for group in &groups {
                let scores: Vec<f64> = group["episodes"]
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|e| e["score"].as_f64().unwrap())
                    .collect();
                flat += usize::from(scores.windows(2).all(|two| two[0] == two[1]));
            }
            pulled += groups.len();
            let _ =
                api.post(&format!("/v1/runs/{run}/trajectories/ack"), json!({"ids": ids})).await.expect(200);
            if pulled >= enough && (refill || flat > 0) {
                break;
            }
        }
        assert!(pulled >= enough, "{run}: {pulled}");
        enough = pulled;
        assert_eq!(flat > 0, !refill, "{run}: {flat} of {pulled} say nothing");
    }
}
