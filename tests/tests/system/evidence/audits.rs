//! Trainers of columns that choose by the audit which leases to prove.

use serde_json::{Value, json};
use system_tests::ApiClient;

use super::{EvidenceServer, create_run, task};
use crate::feed::column_trainer::ColumnClaim;

/// How a trainer ends a lease whose audit it does not like.
#[derive(Debug, Clone, Copy, PartialEq)]
enum End {
    /// It reads the audited groups and releases the lease if one of them lost.
    ReleasesAfterClaim,
    /// It claims nothing and releases the lease if one of its episodes lost.
    ReleasesBeforeClaim,
    /// It claims nothing and lets the lease expire.
    Expires,
    /// It claims every lost episode as failed.
    ClaimsFailures,
}

/// Settings with many contested scenarios, and few audited groups: many leases have no lost group among them.
fn settings() -> Value {
    let table = json!({"columns": ["debris", "spread", "fuel"], "rows": [[100, 1, 20], [125, 1, 10]]});
    json!({"audit_groups": 8, "task_settings": {"kessler/survival": {"levels": table}}})
}

async fn run_lease(api: &ApiClient, run: &str, end: End) {
    let ttl_s = if end == End::Expires { 1 } else { 600 };
    let trainer = ColumnClaim::new(api, run, json!({"groups": 64, "ttl_s": ttl_s}), "hold").await;
    let release = format!("/v1/runs/{run}/leases/{}/release", trainer.lease.id());
    let lost = |entry: usize| trainer.scores[entry] < 0.99;
    match end {
        End::ReleasesAfterClaim => {
            let claim = trainer.claim(api).await;
            let audited = claim["audited_groups"].as_array().unwrap().iter();
            let entries = audited.flat_map(|group| group["entries"].as_array().unwrap());
            if entries.map(|entry| entry.as_u64().unwrap() as usize).any(lost) {
                let _ = api.post(&release, json!({})).await.expect(200);
            } else {
                api.report(run, trainer.audited_results(&claim)).await;
            }
        }
        End::ReleasesBeforeClaim => {
            let _ = api.post(&release, json!({})).await.expect(200);
        }
        End::Expires => {}
        End::ClaimsFailures => {
            let failed: Vec<u8> = (0..trainer.scores.len()).map(|entry| u8::from(lost(entry))).collect();
            let body = json!({"score": trainer.scores, "failed": failed});
            let claim = api.post(&trainer.path(), body).await.expect(200);
            if claim["state"] == "claimed" {
                api.report(run, trainer.audited_results(&claim)).await;
            }
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn audit_that_a_trainer_does_not_like_is_missing_evidence() {
    let server = EvidenceServer::start();
    let api = server.api();
    for (run, end) in [
        ("after", End::ReleasesAfterClaim),
        ("before", End::ReleasesBeforeClaim),
        ("expires", End::Expires),
        ("fails", End::ClaimsFailures),
    ] {
        create_run(&api, run, settings()).await;
        for _ in 0..6 {
            run_lease(&api, run, end).await;
        }
        let settled = system_tests::wait_for("no slot is open", async || {
            let task = task(&api, run).await;
            let shown = &task["mastery"];
            (shown["open"] == 0 && shown["n"].as_u64() > Some(0)).then_some(task)
        });
        let task = settled.await;
        let shown = &task["mastery"];
        assert_eq!(task["level"], 0, "{end:?}: {task}");
        assert!(shown["mean"].as_f64().unwrap() < 0.7, "{end:?}: {shown}");
        assert!(shown["missing"].as_f64().unwrap() > 0.1, "{end:?}: {shown}");
    }
}

/// The sample is secret until the claim: no answer names an audited group.
#[tokio::test(flavor = "multi_thread")]
async fn sample_is_secret_before_the_claim() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", settings()).await;
    let trainer = ColumnClaim::new(&api, "run", json!({"groups": 16}), "hold").await;
    let lease = format!("/v1/runs/run/leases/{}", trainer.lease.id());
    assert_eq!(api.get(&lease).await.expect(200)["groups"], json!([]));
    assert_eq!(api.get("/v1/runs/run/episodes").await.expect(200)["episodes"], json!([]));
    for index in 0..16 {
        let episode = format!("/v1/runs/run/episodes/ep_{}_{index}", trainer.lease.id());
        assert_eq!(api.get(&episode).await.status, 404);
    }
    let claim = trainer.claim(&api).await;
    assert_eq!(claim["audited_groups"].as_array().unwrap().len(), 8);
}
