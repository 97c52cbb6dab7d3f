//! Changes of the settings cannot remove what a trainer lost.

use serde_json::json;

use super::{EvidenceServer, create_run, hold_results, task};

/// A trainer reports its wins. It keeps its losses leased, and changes the strategy there and back after each of them.
#[tokio::test(flavor = "multi_thread")]
async fn change_of_the_strategy_drops_no_lost_scenario() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let (mut wins, mut leases) = (0, Vec::new());
    for _ in 0..40 {
        let lease = api.lease("run", json!({"groups": 1, "ttl_s": 86400})).await;
        let (result, is_won) = hold_results(&lease).remove(0);
        if is_won {
            wins += 1;
            api.report("run", vec![result]).await;
        } else {
            for strategy in ["adr", "ladder"] {
                let settings = json!({"strategy": strategy}).to_string();
                let _ = api.request("PATCH", "/v1/runs/run", "application/json", settings).await.expect(200);
            }
        }
        leases.push(lease.id().to_owned());
    }
    assert!((1..40).contains(&wins), "{wins}");
    let shown = task(&api, "run").await["levels"].clone();
    assert!(shown[0]["n"].as_u64().unwrap() < 40, "results wait for the losses: {shown}");
    for lease in leases {
        let _ = api.post(&format!("/v1/runs/run/leases/{lease}/release"), json!({})).await;
    }
    let (mut low, mut missing) = (0.0, 0.0);
    for level in task(&api, "run").await["levels"].as_array().unwrap() {
        let n = level["n"].as_f64().unwrap();
        low += level["mean"].as_f64().unwrap() * (2.0 + n) - 1.0;
        missing += level["missing"].as_f64().unwrap() * n;
    }
    assert!((low - f64::from(wins)).abs() < 1e-6, "{wins} wins, {low} shown");
    assert!((missing - f64::from(40 - wins)).abs() < 1e-6, "{missing} missing");
}
