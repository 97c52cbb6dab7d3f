//! Column claims: audited episodes count for mastery, claimed ones are statistics only, and a wrong log refuses the claim.

use std::collections::BTreeSet;
use std::sync::atomic::Ordering;

use clock::{Clock, ManualClock};
use env_core::SeedSpace;
use serde_json::{Value, json};
use system_tests::{Server, wait_until};

use super::column_trainer::{ColumnClaim, create_run, scenarios, statuses, task_mastery};

#[tokio::test]
async fn audited_episodes_count_and_claimed_ones_are_statistics() {
    let server = Server::start().await;
    let api = server.api();
    // Levels with many contested scenarios.
    let table = json!({"columns": ["debris", "spread", "fuel"], "rows": [[100, 1, 20], [125, 1, 10]]});
    let levels = json!({"kessler/survival": {"levels": table}});
    create_run(&api, "run", json!({"audit_groups": 40, "group_size": 2, "task_settings": levels})).await;
    let trainer = ColumnClaim::new(&api, "run", json!({"groups": 150}), "heuristic").await;
    assert_eq!(trainer.scores.len(), 300);
    let seeds: BTreeSet<u64> = scenarios(&trainer.lease).iter().map(|s| s.seed().get()).collect();
    assert_eq!(seeds.len(), 150, "every group has a seed of its own");
    assert!(scenarios(&trainer.lease).iter().all(|s| s.seed().space() == SeedSpace::Training));
    assert_eq!(trainer.lease.0["groups"], json!([]), "the audit is unknown before the claim");

    let claim = trainer.claim(&api).await;
    assert_eq!((&claim["state"], &claim["episodes"]), (&json!("claimed"), &json!(300)));
    assert_eq!(claim["audited_groups"].as_array().unwrap().len(), 40);
    let before = task_mastery(&api, "run").await;
    assert_eq!(
        (&before["results"]["episodes"], &before["claimed_results"]["episodes"]),
        (&json!(0), &json!(0))
    );

    // Results arrive in two parts, the first twice: the claim counts once, when the audit is complete.
    let due = trainer.audited_results(&claim);
    assert_eq!(due.len(), 80);
    for _ in 0..2 {
        let report = api.report("run", due[..50].to_vec()).await;
        assert!(statuses(&report).iter().all(|status| ["audited", "duplicate"].contains(status)), "{report}");
        assert_eq!(trainer.claim_state(&api).await["state"], "claimed");
        assert_eq!(task_mastery(&api, "run").await["results"]["episodes"], 0);
    }
    assert_eq!(statuses(&api.report("run", due[50..].to_vec()).await), ["audited"; 30]);
    assert_eq!(trainer.claim_state(&api).await["state"], "accepted");
    let after = task_mastery(&api, "run").await;
    assert_eq!(after["results"]["episodes"], 80);
    assert_eq!(after["claimed_results"]["episodes"], 300);
    let mean = trainer.scores.iter().sum::<f64>() / 300.0;
    assert!((after["claimed_results"]["score"].as_f64().unwrap() - mean).abs() < 1e-6);
    // Audited episodes are part of the claimed ones: the overview counts them once.
    let overview = api.get("/v1/runs/run/overview").await.expect(200);
    assert_eq!(overview["episodes"], 300);
    let series = api.get("/v1/runs/run/series").await.expect(200)["tasks"][0].clone();
    let sum =
        |column: &str| series[column].as_array().unwrap().iter().map(|n| n.as_i64().unwrap()).sum::<i64>();
    assert_eq!((sum("episodes"), sum("claimed")), (80, 220));
    // Only contested scenarios are evidence; the audit determines which are.
    let lease = api.get(&format!("/v1/runs/run/leases/{}", trainer.lease.id())).await.expect(200);
    assert_eq!((&lease["status"], &lease["form"]), (&json!("done"), &json!("columns")));
    let groups = lease["groups"].as_array().unwrap();
    let contested = groups.iter().filter(|group| group["contested"] == true).count();
    assert!(groups.iter().all(|group| group["state"] == "complete" && group["bracket"].is_object()));
    let levels = after["levels"].as_array().unwrap();
    let seen: u64 = levels.iter().map(|level| level["seen"].as_u64().unwrap()).sum();
    assert!(contested > 5 && seen as usize == contested, "{after}");
    // Audited episodes have a replay.
    let episode = groups[0]["episodes"][0].as_str().unwrap();
    let _ = api.get(&format!("/v1/runs/run/episodes/{episode}/replay")).await.expect(200);
    assert_eq!(api.get("/v1/runs/run").await.expect(200)["warnings"]["count"], 0);
}

/// If one audited log has another score than claimed, nothing of the claim counts and the run has a warning.
#[tokio::test]
async fn forged_score_refuses_the_whole_claim() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"audit_groups": 20})).await;
    let mut trainer = ColumnClaim::new(&api, "run", json!({"groups": 60}), "hold").await;
    let honest = trainer.scores.clone();
    for score in &mut trainer.scores {
        *score = 0.999;
    }
    let claim = trainer.claim(&api).await;
    let due = trainer.audited_results(&claim);
    let report = api.report("run", due.clone()).await;
    let results = report["results"].as_array().unwrap();
    let mismatches: Vec<&Value> = results.iter().filter(|r| r["code"] == "columns_mismatch").collect();
    assert!(!mismatches.is_empty(), "{report}");
    assert!(mismatches[0]["detail"].as_str().unwrap().contains("the claim is 0.999000"), "{}", mismatches[0]);
    let state = trainer.claim_state(&api).await;
    assert_eq!(state["state"], "refused");
    assert!(state["reason"].as_str().unwrap().contains(mismatches[0]["episode"].as_str().unwrap()));
    let after = task_mastery(&api, "run").await;
    assert_eq!(
        (&after["results"]["episodes"], &after["claimed_results"]["refused"]),
        (&json!(0), &json!(60))
    );
    assert_eq!(after["claimed_results"]["episodes"], 0);
    let run = api.get("/v1/runs/run").await.expect(200);
    assert_eq!(run["warnings"]["count"], 1, "{run}");
    assert_eq!(run["warnings"]["newest"][0]["kind"], "refused_claim");
    assert_eq!(run["warnings"]["newest"][0]["lease"], trainer.lease.id());
    // A refused claim cannot be replaced.
    trainer.scores = honest;
    let repeated = api.post(&trainer.path(), json!({"score": trainer.scores})).await.expect(409);
    assert_eq!(repeated["type"], "urn:sparring:problem:columns_conflict");
    // An episode that was claimed as finished cannot be reported as failed in the audit.
    let trainer = ColumnClaim::new(&api, "run", json!({"groups": 30}), "hold").await;
    let claim = trainer.claim(&api).await;
    let failed_result = json!({"episode": claim["audited_groups"][0]["episodes"][0], "status": "failed", "reason": "disk full"});
    assert_eq!(api.report("run", vec![failed_result]).await["results"][0]["code"], "columns_mismatch");
    assert_eq!(trainer.claim_state(&api).await["state"], "refused");
}

#[tokio::test]
async fn unproven_claim_counts_for_nothing() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(1_000_000);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    create_run(&api, "run", json!({"audit_groups": 8})).await;
    // The claim renews the lease, which then expires before the audit is complete.
    let late = ColumnClaim::new(&api, "run", json!({"groups": 20, "ttl_s": 100}), "hold").await;
    clock_ms.fetch_add(80_000, Ordering::SeqCst);
    let claim = late.claim(&api).await;
    // A claimed lease cannot be renewed, so that there is no time to forge logs.
    let renew = format!("/v1/runs/run/leases/{}/renew", late.lease.id());
    assert_eq!(api.post(&renew, json!({})).await.expect(409)["type"], "urn:sparring:problem:audit_due");
    clock_ms.fetch_add(80_000, Ordering::SeqCst);
    let due = late.audited_results(&claim);
    assert_eq!(statuses(&api.report("run", due[..7].to_vec()).await), ["audited"; 7]);
    clock_ms.fetch_add(30_000, Ordering::SeqCst);
    wait_until("the claim is unproven", async || late.claim_state(&api).await["state"] == "unproven").await;
    assert_eq!(statuses(&api.report("run", due[7..].to_vec()).await), ["late"]);
    // A lease that is released after its claim.
    let released = ColumnClaim::new(&api, "run", json!({"groups": 20}), "hold").await;
    let _ = released.claim(&api).await;
    let path = format!("/v1/runs/run/leases/{}/release", released.lease.id());
    let _ = api.post(&path, json!({})).await.expect(200);
    assert_eq!(released.claim_state(&api).await["state"], "unproven");
    // Withheld audits add warnings to the run.
    let warnings = api.get("/v1/runs/run").await.expect(200)["warnings"].clone();
    assert_eq!(
        (&warnings["count"], &warnings["newest"][0]["kind"]),
        (&json!(2), &json!("unproven_claim")),
        "{warnings}"
    );
    // A lease that is never claimed.
    let unclaimed = ColumnClaim::new(&api, "run", json!({"groups": 20, "ttl_s": 100}), "hold").await;
    clock_ms.fetch_add(101_000, Ordering::SeqCst);
    let over = api.post(&unclaimed.path(), json!({"score": unclaimed.scores})).await.expect(409);
    assert_eq!(over["type"], "urn:sparring:problem:lease_closed");
    wait_until("the lease expires", async || {
        task_mastery(&api, "run").await["claimed_results"]["expired"] == 20
    })
    .await;
    let after = task_mastery(&api, "run").await;
    let claimed = &after["claimed_results"];
    assert_eq!((&claimed["unproven"], &claimed["expired"]), (&json!(40), &json!(20)), "{claimed}");
    assert_eq!((&claimed["episodes"], &after["results"]["episodes"]), (&json!(0), &json!(0)));
}

#[tokio::test]
async fn failed_episodes_of_a_claim_are_not_low_scores() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"audit_groups": 30})).await;
    let trainer = ColumnClaim::new(&api, "run", json!({"groups": 60}), "heuristic").await;
    let failed: Vec<u8> = (0..60).map(|at| u8::from(at % 5 == 0)).collect();
    let entries = format!("{}/entries", trainer.path());
    assert_eq!(api.get(&entries).await.expect(404)["type"], "urn:sparring:problem:no_columns");
    let claim =
        api.post(&trainer.path(), json!({"score": trainer.scores, "failed": failed})).await.expect(200);
    assert_eq!(claim["failed"], 12);
    // Entries are returned as they were sent, in single precision.
    let kept = api.get(&entries).await.expect(200);
    let single = |score: f64| score as f32;
    let scores: Vec<f32> =
        kept["score"].as_array().unwrap().iter().map(|score| single(score.as_f64().unwrap())).collect();
    assert_eq!(scores, trainer.scores.iter().map(|score| single(*score)).collect::<Vec<_>>());
    assert_eq!(
        (&kept["state"], &kept["failed"], &kept["steps"]),
        (&json!("claimed"), &json!(failed), &json!([]))
    );
    let audited: Vec<u64> = claim["audited_groups"]
        .as_array()
        .unwrap()
        .iter()
        .map(|a| a["entries"][0].as_u64().unwrap())
        .collect();
    assert!(audited.iter().all(|at| at % 5 != 0), "failed episodes are not audited: {audited:?}");
    let _ = api.report("run", trainer.audited_results(&claim)).await;
    assert_eq!(trainer.claim_state(&api).await["state"], "accepted");
    let after = task_mastery(&api, "run").await;
    assert_eq!(
        (&after["claimed_results"]["episodes"], &after["claimed_results"]["failed"]),
        (&json!(48), &json!(12))
    );
    // The sample of 30 groups includes failed ones, which count as missing beside the audited ones.
    let failed = after["results"]["failed"].as_u64().unwrap();
    assert!((1..=12).contains(&failed), "{after}");
    assert_eq!(after["level"], 0);
    // If every episode failed, nothing is audited and the claim is accepted.
    let trainer = ColumnClaim::new(&api, "run", json!({"groups": 5}), "hold").await;
    let all = json!({"score": trainer.scores, "failed": [1, 1, 1, 1, 1]});
    let report = api.post(&trainer.path(), all).await.expect(200);
    assert_eq!(
        (&report["state"], &report["audited_groups"]),
        (&json!("accepted"), &json!([])),
        "the claim is accepted at once"
    );
    assert_eq!(trainer.claim_state(&api).await["state"], "accepted");
}

/// The finished episodes of a partly failed group are audited like all others.
#[tokio::test]
async fn partly_failed_groups_are_audited() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"audit_groups": 12, "group_size": 4})).await;
    let failed: Vec<u8> = (0..80).map(|at| u8::from(at % 4 == 1)).collect();
    let claim_scores = async |claim: &ColumnClaim, scores: &[f64]| {
        let response = api.post(&claim.path(), json!({"score": scores, "failed": failed})).await.expect(200);
        let audit = response["audited_groups"].as_array().unwrap();
        assert_eq!(audit.len(), 12);
        for group in audit {
            let entries: Vec<u64> =
                group["entries"].as_array().unwrap().iter().map(|entry| entry.as_u64().unwrap()).collect();
            let first = group["group"].as_u64().unwrap() * 4;
            assert_eq!(entries, [first, first + 2, first + 3], "the second episode failed");
        }
        response
    };
    let honest = ColumnClaim::new(&api, "run", json!({"groups": 20}), "hold").await;
    let claim = claim_scores(&honest, &honest.scores).await;
    // A failed episode may be reported as failed again.
    let first = claim["audited_groups"][0]["group"].as_u64().unwrap() * 4;
    let name = claim["audited_groups"][0]["episodes"][0].as_str().unwrap();
    let failed_episode = name.replace(&format!("_{first}"), &format!("_{}", first + 1));
    let failed_result = json!({"episode": failed_episode, "status": "failed", "reason": "disk full"});
    assert_eq!(statuses(&api.report("run", vec![failed_result]).await), ["failed"]);
    assert_eq!(statuses(&api.report("run", honest.audited_results(&claim)).await), ["audited"; 36]);
    assert_eq!(honest.claim_state(&api).await["state"], "accepted");
    let forged = ColumnClaim::new(&api, "run", json!({"groups": 20}), "hold").await;
    let claim = claim_scores(&forged, &[0.999; 80]).await;
    let _ = api.report("run", forged.audited_results(&claim)).await;
    assert_eq!(forged.claim_state(&api).await["state"], "refused");
    // If only one group has a finished episode, the audit draws it.
    let few = ColumnClaim::new(&api, "run", json!({"groups": 20}), "hold").await;
    let failed: Vec<u8> = (0..80).map(|at| u8::from(at != 33)).collect();
    let claim = api.post(&few.path(), json!({"score": few.scores, "failed": failed})).await.expect(200);
    assert_eq!(claim["audited_groups"].as_array().unwrap().len(), 1);
    assert_eq!(claim["audited_groups"][0]["entries"], json!([33]));
}

#[tokio::test]
async fn repeated_claim_after_a_restart_has_the_same_audit() {
    let mut server = Server::start().await;
    create_run(&server.api(), "run", json!({"audit_groups": 10})).await;
    let trainer = ColumnClaim::new(&server.api(), "run", json!({"groups": 40}), "hold").await;
    let claim = trainer.claim(&server.api()).await;
    server.restart().await;
    let api = server.api();
    assert_eq!(trainer.claim(&api).await, claim, "the same columns, the same audit");
    let mut other = trainer.scores.clone();
    other[3] = 0.5;
    let rejected = api.post(&trainer.path(), json!({"score": other})).await.expect(409);
    assert_eq!(rejected["type"], "urn:sparring:problem:columns_conflict");
    assert_eq!(statuses(&api.report("run", trainer.audited_results(&claim)).await), ["audited"; 10]);
    assert_eq!(trainer.claim_state(&api).await["state"], "accepted");
    // The next lease equals that of a server that was not restarted.
    let next = api.lease("run", json!({"form": "columns", "groups": 64})).await;
    let uninterrupted = Server::start().await;
    create_run(&uninterrupted.api(), "run", json!({"audit_groups": 10})).await;
    let _ = uninterrupted.api().lease("run", json!({"form": "columns", "groups": 40})).await;
    let expected = uninterrupted.api().lease("run", json!({"form": "columns", "groups": 64})).await;
    assert_eq!(next.0["ranges"].as_array().unwrap().len(), expected.0["ranges"].as_array().unwrap().len());
}

/// A trainer cannot predict the audit: equal claims are audited differently.
#[tokio::test]
async fn audit_is_unpredictable() {
    let mut audits = BTreeSet::new();
    for _ in 0..3 {
        let server = Server::start().await;
        create_run(&server.api(), "run", json!({"audit_groups": 8})).await;
        let trainer = ColumnClaim::new(&server.api(), "run", json!({"groups": 300}), "hold").await;
        let claim = trainer.claim(&server.api()).await;
        audits.insert(
            claim["audited_groups"]
                .as_array()
                .unwrap()
                .iter()
                .map(|a| a["group"].to_string())
                .collect::<Vec<_>>(),
        );
    }
    assert_eq!(audits.len(), 3);
}
