//! Two servers with a shard each behind nginx: merged lists, routing by shard, a server that is away, and errors of the start.

mod absent;
mod lists;
mod routing;
mod starts;
mod tokens;

use serde_json::{Value, json};
use system_tests::ApiClient;

const TASK: &str = "kessler/survival";

/// Creates a run with fast settings and returns its id. `settings` has further fields.
async fn create(api: &ApiClient, settings: Value) -> String {
    let mut request = json!({"tasks": [TASK], "strategy": "ladder", "design": {"designer": "off"}});
    request.as_object_mut().unwrap().extend(settings.as_object().unwrap().clone());
    let run = api.post("/v1/runs", request).await.expect(201);
    run["id"].as_str().unwrap().to_owned()
}

/// Leases groups of a run and reports their results, all of which must count.
async fn train(api: &ApiClient, run: &str, groups: u32) {
    let lease = api.lease(run, json!({"groups": groups})).await;
    let answer = api.report(run, lease.results("hold")).await;
    for result in answer["results"].as_array().unwrap() {
        assert_eq!(result["status"], "counted", "{result}");
    }
}

/// Returns the ids of a list of runs.
fn ids(page: &Value) -> Vec<String> {
    page["runs"].as_array().unwrap().iter().map(|run| run["id"].as_str().unwrap().to_owned()).collect()
}

/// Returns a field of each item of all pages of a list.
async fn all_pages(api: &ApiClient, path: &str, items: &str, field: &str) -> Vec<String> {
    let (mut all, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = api.get(&format!("{path}{cursor}")).await.expect(200);
        assert_eq!(page["missing_shards"], json!([]), "{page}");
        all.extend(
            page[items].as_array().unwrap().iter().map(|item| item[field].as_str().unwrap().to_owned()),
        );
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return all,
        }
    }
}
