//! Columns: what is claimed is a statistic, what is audited counts, and what does not replay refuses all of it.

use std::collections::BTreeSet;
use std::sync::atomic::Ordering;
use std::time::Duration;

use env_core::SeedSpace;
use orchestrator::clock::Clock;
use serde_json::{Value, json};
use system_tests::{Api, Server};

use super::trainer::{Flight, mastery, run, scenarios, words};

#[tokio::test]
async fn what_is_audited_moves_mastery_and_the_rest_is_a_statistic() {
    let server = Server::start().await;
    let api = server.api();
    // Levels at which acting well often matters.
    let table = json!({"columns": ["debris", "spread", "fuel"], "rows": [[100, 1, 20], [125, 1, 10]]});
    let levels = json!({"kessler/survival": {"levels": table}});
    run(&api, "run", json!({"audit_groups": 40, "group_size": 2, "task_settings": levels})).await;
    let flight = Flight::new(&api, "run", json!({"groups": 150}), "heuristic").await;
    assert_eq!(flight.scores.len(), 300);
    let seeds: BTreeSet<u64> = scenarios(&flight.lease).iter().map(|s| s.seed().get()).collect();
    assert_eq!(seeds.len(), 150, "every group has a seed of its own");
    assert!(scenarios(&flight.lease).iter().all(|s| s.seed().space() == SeedSpace::Training));
    assert_eq!(flight.lease.0["groups"], json!([]), "nothing is audited before it is claimed");

    let claim = flight.claim(&api).await;
    assert_eq!((&claim["state"], &claim["episodes"]), (&json!("claimed"), &json!(300)));
    assert_eq!(claim["audit"].as_array().unwrap().len(), 40);
    let before = mastery(&api, "run").await;
    assert_eq!((&before["plain"]["episodes"], &before["claimed"]["episodes"]), (&json!(0), &json!(0)));

    // In two parts, the first twice: it counts when all of it is in, and once.
    let due = flight.due(&claim);
    assert_eq!(due.len(), 80);
    for _ in 0..2 {
        let told = api.report("run", due[..50].to_vec()).await;
        assert!(words(&told).iter().all(|word| ["audited", "duplicate"].contains(word)), "{told}");
        assert_eq!(flight.standing(&api).await["state"], "claimed");
        assert_eq!(mastery(&api, "run").await["plain"]["episodes"], 0);
    }
    assert_eq!(words(&api.report("run", due[50..].to_vec()).await), ["audited"; 30]);
    assert_eq!(flight.standing(&api).await["state"], "accepted");
    let after = mastery(&api, "run").await;
    assert_eq!(after["plain"]["episodes"], 80);
    assert_eq!(after["claimed"]["episodes"], 300);
    let mean = flight.scores.iter().sum::<f64>() / 300.0;
    assert!((after["claimed"]["score"].as_f64().unwrap() - mean).abs() < 1e-6);
    // What was audited is of what was claimed: it is shown once.
    let glance = api.get("/v1/runs/run/overview").await.expect(200);
    assert_eq!(glance["episodes"], 300);
    let series = api.get("/v1/runs/run/series").await.expect(200)["tasks"][0].clone();
    let shown =
        |column: &str| series[column].as_array().unwrap().iter().map(|n| n.as_i64().unwrap()).sum::<i64>();
    assert_eq!((shown("episodes"), shown("claimed")), (80, 220));
    // Only contested scenarios are evidence, and they were found to be at the audit.
    let lease = api.get(&format!("/v1/runs/run/leases/{}", flight.lease.id())).await.expect(200);
    assert_eq!((&lease["status"], &lease["form"]), (&json!("done"), &json!("columns")));
    let groups = lease["groups"].as_array().unwrap();
    let contested = groups.iter().filter(|group| group["contested"] == true).count();
    assert!(groups.iter().all(|group| group["state"] == "complete" && group["bracket"].is_object()));
    let levels = after["levels"].as_array().unwrap();
    let seen: u64 = levels.iter().map(|level| level["seen"].as_u64().unwrap()).sum();
    assert!(contested > 5 && seen as usize == contested, "{after}");
    // A replay of an audited episode is there to be looked at; of another there is none.
    let episode = groups[0]["episodes"][0].as_str().unwrap();
    let _ = api.get(&format!("/v1/runs/run/episodes/{episode}/replay")).await.expect(200);
    assert_eq!(api.get("/v1/runs/run").await.expect(200)["marks"]["count"], 0);
}

/// One audited log that earns something else than was claimed: nothing of the claim counts, and the run is marked.
#[tokio::test]
async fn a_forged_score_refuses_all_of_it() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({"audit_groups": 20})).await;
    let mut flight = Flight::new(&api, "run", json!({"groups": 60}), "hold").await;
    let honest = flight.scores.clone();
    for score in &mut flight.scores {
        *score = 0.999;
    }
    let claim = flight.claim(&api).await;
    let due = flight.due(&claim);
    let told = api.report("run", due.clone()).await;
    let results = told["results"].as_array().unwrap();
    let lying: Vec<&Value> = results.iter().filter(|r| r["code"] == "not_as_claimed").collect();
    assert!(!lying.is_empty(), "{told}");
    assert!(lying[0]["detail"].as_str().unwrap().contains("0.999000 was claimed"), "{}", lying[0]);
    let standing = flight.standing(&api).await;
    assert_eq!(standing["state"], "refused");
    assert!(standing["why"].as_str().unwrap().contains(lying[0]["episode"].as_str().unwrap()));
    let after = mastery(&api, "run").await;
    assert_eq!((&after["plain"]["episodes"], &after["claimed"]["refused"]), (&json!(0), &json!(60)));
    assert_eq!(after["claimed"]["episodes"], 0);
    let shown = api.get("/v1/runs/run").await.expect(200);
    assert_eq!(shown["marks"]["count"], 1, "{shown}");
    assert_eq!(shown["marks"]["newest"][0]["kind"], "refused_claim");
    assert_eq!(shown["marks"]["newest"][0]["lease"], flight.lease.id());
    // There is no second chance.
    flight.scores = honest;
    let again = api.post(&flight.path(), json!({"score": flight.scores})).await.expect(409);
    assert_eq!(again["type"], "urn:sparring:problem:claimed_otherwise");
    // An episode that was claimed to be finished cannot be lost when its log is due.
    let flight = Flight::new(&api, "run", json!({"groups": 30}), "hold").await;
    let claim = flight.claim(&api).await;
    let lost =
        json!({"episode": claim["audit"][0]["episodes"][0], "status": "failed", "reason": "disk full"});
    assert_eq!(api.report("run", vec![lost]).await["results"][0]["code"], "not_as_claimed");
    assert_eq!(flight.standing(&api).await["state"], "refused");
}

async fn becomes(api: &Api, flight: &Flight, state: &str) {
    for _ in 0..200 {
        if flight.standing(api).await["state"] == state {
            return;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("the claim did not become {state}");
}

#[tokio::test]
async fn what_is_not_proven_in_time_counts_for_nothing() {
    let (clock, hand) = Clock::manual(1_000_000);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    run(&api, "run", json!({"audit_groups": 8})).await;
    // The columns renew the lease; then its time is over with a log missing.
    let late = Flight::new(&api, "run", json!({"groups": 20, "ttl_s": 100}), "hold").await;
    hand.fetch_add(80_000, Ordering::SeqCst);
    let claim = late.claim(&api).await;
    // Nobody has longer to make up a log than to have flown it.
    let renew = format!("/v1/runs/run/leases/{}/renew", late.lease.id());
    assert_eq!(api.post(&renew, json!({})).await.expect(409)["type"], "urn:sparring:problem:audit_due");
    hand.fetch_add(80_000, Ordering::SeqCst);
    let due = late.due(&claim);
    assert_eq!(words(&api.report("run", due[..7].to_vec()).await), ["audited"; 7]);
    hand.fetch_add(30_000, Ordering::SeqCst);
    becomes(&api, &late, "unproven").await;
    assert_eq!(words(&api.report("run", due[7..].to_vec()).await), ["late"]);
    // Given back after it was claimed.
    let released = Flight::new(&api, "run", json!({"groups": 20}), "hold").await;
    let _ = released.claim(&api).await;
    let path = format!("/v1/runs/run/leases/{}/release", released.lease.id());
    let _ = api.post(&path, json!({})).await.expect(200);
    assert_eq!(released.standing(&api).await["state"], "unproven");
    // Who sees what is audited and keeps it back leaves a trace.
    let marks = api.get("/v1/runs/run").await.expect(200)["marks"].clone();
    assert_eq!(
        (&marks["count"], &marks["newest"][0]["kind"]),
        (&json!(2), &json!("unproven_claim")),
        "{marks}"
    );
    // Never claimed.
    let silent = Flight::new(&api, "run", json!({"groups": 20, "ttl_s": 100}), "hold").await;
    hand.fetch_add(101_000, Ordering::SeqCst);
    let over = api.post(&silent.path(), json!({"score": silent.scores})).await.expect(409);
    assert_eq!(over["type"], "urn:sparring:problem:lease_over");
    for _ in 0..200 {
        if mastery(&api, "run").await["claimed"]["expired"] == 20 {
            break;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let after = mastery(&api, "run").await;
    let claimed = &after["claimed"];
    assert_eq!((&claimed["unproven"], &claimed["expired"]), (&json!(40), &json!(20)), "{claimed}");
    assert_eq!((&claimed["episodes"], &after["plain"]["episodes"]), (&json!(0), &json!(0)));
}

#[tokio::test]
async fn what_failed_is_no_low_score_and_too_much_of_it_is_no_evidence() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({"audit_groups": 30})).await;
    let flight = Flight::new(&api, "run", json!({"groups": 60}), "heuristic").await;
    let failed: Vec<u8> = (0..60).map(|at| u8::from(at % 5 == 0)).collect();
    let entries = format!("{}/entries", flight.path());
    assert_eq!(api.get(&entries).await.expect(404)["type"], "urn:sparring:problem:no_columns");
    let claim = api.post(&flight.path(), json!({"score": flight.scores, "failed": failed})).await.expect(200);
    assert_eq!(claim["failed"], 12);
    // They read back as they came, in single precision.
    let kept = api.get(&entries).await.expect(200);
    let single = |score: f64| score as f32;
    let scores: Vec<f32> =
        kept["score"].as_array().unwrap().iter().map(|score| single(score.as_f64().unwrap())).collect();
    assert_eq!(scores, flight.scores.iter().map(|score| single(*score)).collect::<Vec<_>>());
    assert_eq!(
        (&kept["state"], &kept["failed"], &kept["steps"]),
        (&json!("claimed"), &json!(failed), &json!([]))
    );
    let audited: Vec<u64> =
        claim["audit"].as_array().unwrap().iter().map(|a| a["entries"][0].as_u64().unwrap()).collect();
    assert!(audited.iter().all(|at| at % 5 != 0), "what failed has no log: {audited:?}");
    let _ = api.report("run", flight.due(&claim)).await;
    assert_eq!(flight.standing(&api).await["state"], "accepted");
    let after = mastery(&api, "run").await;
    assert_eq!((&after["claimed"]["episodes"], &after["claimed"]["failed"]), (&json!(48), &json!(12)));
    assert_eq!(after["plain"]["failed"], 0);
    assert_eq!(after["mastery"]["seen"], 0, "12 of 60 is more than a tenth: {after}");
    // All of it: nothing can be audited, and the claim stands for what it is.
    let flight = Flight::new(&api, "run", json!({"groups": 5}), "hold").await;
    let all = json!({"score": flight.scores, "failed": [1, 1, 1, 1, 1]});
    let told = api.post(&flight.path(), all).await.expect(200);
    assert_eq!((&told["state"], &told["audit"]), (&json!("accepted"), &json!([])), "it has ended by then");
    assert_eq!(flight.standing(&api).await["state"], "accepted");
}

/// A failed sibling hides nothing: what finished of its group is audited like everything else.
#[tokio::test]
async fn one_failure_a_group_hides_no_forgery() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({"audit_groups": 12, "group_size": 4})).await;
    let failed: Vec<u8> = (0..80).map(|at| u8::from(at % 4 == 1)).collect();
    let claimed = async |flight: &Flight, scores: &[f64]| {
        let claim = api.post(&flight.path(), json!({"score": scores, "failed": failed})).await.expect(200);
        let audit = claim["audit"].as_array().unwrap();
        assert_eq!(audit.len(), 12);
        for group in audit {
            let entries: Vec<u64> =
                group["entries"].as_array().unwrap().iter().map(|entry| entry.as_u64().unwrap()).collect();
            let first = group["group"].as_u64().unwrap() * 4;
            assert_eq!(entries, [first, first + 2, first + 3], "the second failed");
        }
        claim
    };
    let honest = Flight::new(&api, "run", json!({"groups": 20}), "hold").await;
    let claim = claimed(&honest, &honest.scores).await;
    // That what failed did fail may be said again.
    let first = claim["audit"][0]["group"].as_u64().unwrap() * 4;
    let name = claim["audit"][0]["episodes"][0].as_str().unwrap();
    let lost = name.replace(&format!("_{first}"), &format!("_{}", first + 1));
    let lost = json!({"episode": lost, "status": "failed", "reason": "disk full"});
    assert_eq!(words(&api.report("run", vec![lost]).await), ["failed"]);
    assert_eq!(words(&api.report("run", honest.due(&claim)).await), ["audited"; 36]);
    assert_eq!(honest.standing(&api).await["state"], "accepted");
    let forged = Flight::new(&api, "run", json!({"groups": 20}), "hold").await;
    let claim = claimed(&forged, &[0.999; 80]).await;
    let _ = api.report("run", forged.due(&claim)).await;
    assert_eq!(forged.standing(&api).await["state"], "refused");
    // One group that finished among many that failed is what is drawn.
    let few = Flight::new(&api, "run", json!({"groups": 20}), "hold").await;
    let failed: Vec<u8> = (0..80).map(|at| u8::from(at != 33)).collect();
    let claim = api.post(&few.path(), json!({"score": few.scores, "failed": failed})).await.expect(200);
    assert_eq!(claim["audit"].as_array().unwrap().len(), 1);
    assert_eq!(claim["audit"][0]["entries"], json!([33]));
}

#[tokio::test]
async fn claims_survive_a_restart_and_are_answered_as_before() {
    let mut server = Server::start().await;
    run(&server.api(), "run", json!({"audit_groups": 10})).await;
    let flight = Flight::new(&server.api(), "run", json!({"groups": 40}), "hold").await;
    let claim = flight.claim(&server.api()).await;
    server.restart().await;
    let api = server.api();
    assert_eq!(flight.claim(&api).await, claim, "the same columns, the same audit");
    let mut other = flight.scores.clone();
    other[3] = 0.5;
    let refused = api.post(&flight.path(), json!({"score": other})).await.expect(409);
    assert_eq!(refused["type"], "urn:sparring:problem:claimed_otherwise");
    assert_eq!(words(&api.report("run", flight.due(&claim)).await), ["audited"; 10]);
    assert_eq!(flight.standing(&api).await["state"], "accepted");
    // What comes next is what would have come without the restart.
    let next = api.lease("run", json!({"form": "columns", "groups": 64})).await;
    let calm = Server::start().await;
    run(&calm.api(), "run", json!({"audit_groups": 10})).await;
    let _ = calm.api().lease("run", json!({"form": "columns", "groups": 40})).await;
    let wanted = calm.api().lease("run", json!({"form": "columns", "groups": 64})).await;
    assert_eq!(next.0["ranges"].as_array().unwrap().len(), wanted.0["ranges"].as_array().unwrap().len());
}

/// What is audited follows from nothing that a trainer knows.
#[tokio::test]
async fn the_same_claim_is_audited_otherwise_each_time() {
    let mut audits = BTreeSet::new();
    for _ in 0..3 {
        let server = Server::start().await;
        run(&server.api(), "run", json!({"audit_groups": 8})).await;
        let flight = Flight::new(&server.api(), "run", json!({"groups": 300}), "hold").await;
        let claim = flight.claim(&server.api()).await;
        audits.insert(
            claim["audit"].as_array().unwrap().iter().map(|a| a["group"].to_string()).collect::<Vec<_>>(),
        );
    }
    assert_eq!(audits.len(), 3);
}
