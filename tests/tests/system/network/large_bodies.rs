//! Many large bodies at once: other requests are answered meanwhile, and the memory is bounded.

use std::time::{Duration, Instant};

use serde_json::json;
use system_tests::{ApiClient, ServerProcess};

/// Number of requests at once.
const REQUESTS: usize = 12;

/// JSON object of about 11 MiB with 0.9 million keys.
fn many_keys() -> String {
    let keys: Vec<String> = (0..900_000).map(|n| format!("\"k{n:06}\":0")).collect();
    format!("{{{}}}", keys.join(","))
}

/// Sends bodies to a path at once, and returns the statuses and the longest time that `/livez` took meanwhile.
async fn flood(api: &ApiClient, path: &str, body: &str) -> (Vec<u16>, Duration) {
    let requests: Vec<_> = (0..REQUESTS)
        .map(|_| {
            let (api, path, body) = (api.clone(), path.to_owned(), body.to_owned());
            // The server may close the connection before it has read the body.
            tokio::spawn(async move {
                let response = api.try_request("POST", &path, "application/json", body).await;
                response.map_or(413, |response| response.status)
            })
        })
        .collect();
    let mut longest = Duration::ZERO;
    while requests.iter().any(|request| !request.is_finished()) {
        let start = Instant::now();
        assert_eq!(api.get("/livez").await.status, 200);
        longest = longest.max(start.elapsed());
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let mut statuses = Vec::new();
    for request in requests {
        statuses.push(request.await.unwrap());
    }
    (statuses, longest)
}

#[tokio::test(flavor = "multi_thread")]
async fn large_bodies_delay_nothing_and_use_bounded_memory() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run", "design": {"designer": "off"}})).await.expect(201);
    let keys = many_keys();
    let before = server.peak_resident_mib();
    let settings = format!("{{\"task_settings\":{keys}}}");
    let (statuses, settings_livez) = flood(&api, "/v1/runs", &settings).await;
    assert_eq!(statuses, [413; REQUESTS]);
    let after_settings = server.peak_resident_mib();
    let results = format!("{{\"results\":[{keys}]}}");
    let (statuses, results_livez) = flood(&api, "/v1/runs/run/results", &results).await;
    assert_eq!(statuses, [413; REQUESTS]);
    let after_results = server.peak_resident_mib();
    println!(
        "peak {before} MiB, {after_settings} MiB after settings, {after_results} MiB after results; \
         longest /livez {settings_livez:?} and {results_livez:?}"
    );
    // Twelve bodies have 132 MiB. Of results, three are in memory at once, with 400 000 keys each.
    assert!(after_settings - before < 64, "{before} MiB, then {after_settings} MiB");
    assert!(after_results - before < 256, "{before} MiB, then {after_results} MiB");
    let longest = settings_livez.max(results_livez);
    assert!(longest < Duration::from_millis(500), "/livez took {longest:?}");
}

/// The bounds admit every valid batch: here 5 000 results with all fields.
#[tokio::test]
async fn largest_batch_of_results_is_within_the_limits() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run", "design": {"designer": "off"}})).await.expect(201);
    let steps: Vec<_> = (0..100).map(|_| json!([[0, 0.125, -0.5]])).collect();
    let result = json!({
        "episode": "ep_1-aaaaaa_0", "status": "finished", "policy_version": 1,
        "actions": {"steps": steps, "precision": "f32"},
        "metrics": {"tokens_in": 1, "tokens_out": 1, "invalid_actions": 0, "temperature": 1.0, "max_mc": 0.5,
                    "positive_value_loss": 0.5},
    });
    let body = json!({"results": vec![result; 5000]}).to_string();
    assert!(body.len() < 16 << 20, "{} bytes", body.len());
    let response = api.request("POST", "/v1/runs/run/results", "application/json", body).await.expect(200);
    assert_eq!(response["results"].as_array().unwrap().len(), 5000);
    assert!(
        response["results"][4999].to_string().contains("unknown_episode"),
        "{}",
        response["results"][4999]
    );
}
