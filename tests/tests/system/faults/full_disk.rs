//! A full disk stops changes, and no read: every GET of the API answers as before.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use system_tests::faults::{ENOSPC, Fault};
use system_tests::{ApiClient, http_client, wait_for};
use tokio::task::JoinSet;

use super::{FaultyServer, report, start_run, wait_until_ready};

/// Values of the parameters in paths of the API.
type PathValues = BTreeMap<&'static str, String>;

/// Creates a lease with some results, an evaluation, a policy and layouts, so that all kinds of objects exist.
async fn populate(api: &ApiClient) -> (PathValues, Vec<Value>) {
    let (results, lease) = start_run(api).await;
    let receipts = report(api, &results[..4]).await.expect(200);
    let evaluation = api.post("/v1/evaluations", json!({"policy": "mine", "run": "run"})).await.expect(201);
    let request = json!({"count": 1, "designer": "procedural"});
    let request = api.post("/v1/runs/run/designs", request).await.expect(202);
    let layout = wait_for("a layout is designed", async || {
        let listed = api.get("/v1/runs/run/designs").await.expect(200);
        listed["designs"].as_array().unwrap().first().cloned()
    });
    let layout = layout.await;
    let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let values = [
        ("run", "run".to_owned()),
        ("lease", text(&lease["lease"])),
        ("episode", text(&receipts["results"][0]["episode"])),
        ("evaluation", text(&evaluation["id"])),
        ("request", text(&request["id"])),
        ("design", text(&layout["id"])),
        ("layout", text(&layout["id"])),
    ];
    (values.into(), results)
}

/// Paths of all GET operations, with their parameters filled in.
async fn get_paths(api: &ApiClient, values: &PathValues) -> Vec<String> {
    let document = api.get("/openapi.json").await.expect(200);
    let operations = document["paths"].as_object().unwrap().iter();
    let templates = operations.filter(|(_, methods)| methods.get("get").is_some()).map(|(path, _)| path);
    let fill = |template: &String| {
        let path = values
            .iter()
            .fold(template.clone(), |path, (name, value)| path.replace(&format!("{{{name}}}"), value));
        assert!(!path.contains('{'), "the test has no value for a parameter of {path}");
        path
    };
    templates.map(fill).collect()
}

/// Status of a GET request. The body of an event stream has no end, so no body is read.
async fn status(api: &ApiClient, path: &str) -> u16 {
    let request = http_client().get(format!("{}{path}", api.base())).timeout(Duration::from_secs(30));
    request.send().await.unwrap_or_else(|error| panic!("{path}: {error}")).status().as_u16()
}

/// Leases and reports on a full disk for ever.
async fn fail_changes(api: ApiClient, results: Vec<Value>) {
    loop {
        let lease = api.post("/v1/runs/run/leases", json!({"groups": 1})).await;
        assert_eq!(lease.status, 503, "{}", lease.body);
        let rejected = report(&api, &results[4..]).await;
        assert_eq!(rejected.status, 503, "{}", rejected.body);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn full_disk_changes_no_read() {
    let server = FaultyServer::start();
    let api = server.api();
    let (values, results) = populate(&api).await;
    let mut paths = get_paths(&api, &values).await;
    paths.retain(|path| path != "/readyz");
    let mut before = BTreeMap::new();
    for path in &paths {
        before.insert(path, status(&api, path).await);
    }
    assert!(before.values().filter(|status| **status == 200).count() > 30, "{before:?}");
    server.set(Fault::Write, ENOSPC);
    // The server cannot store the scenarios that these leases need, so it does not wait until they are prepared.
    for _ in 0..2 {
        let start = Instant::now();
        let lease = api.post("/v1/runs/run/leases", json!({"groups": 64})).await;
        assert!(
            lease.status == 503 && lease.body["detail"].to_string().contains("disk is full"),
            "{}",
            lease.body
        );
        assert!(start.elapsed() < Duration::from_secs(8), "{:?}", start.elapsed());
    }
    // Changes that fail share the writer with the reads.
    let changes: JoinSet<()> = (0..8).map(|_| fail_changes(api.clone(), results.clone())).collect();
    for _ in 0..4 {
        for path in &paths {
            assert_eq!(status(&api, path).await, before[path], "{path} on a full disk");
        }
    }
    drop(changes);
    server.set(Fault::Write, 0);
    wait_until_ready(&api).await;
    server.stop_and_check().await;
}
