//! A run with rows in as many tables as a test can fill in seconds.

use serde_json::{Value, json};
use system_tests::{ApiClient, wait_for};

use super::TASK;
use crate::feed::column_trainer::ColumnClaim;

/// Ids of what a populated run has.
pub(crate) struct PopulatedRun {
    pub(crate) lease: String,
    pub(crate) columns: String,
    pub(crate) episode: String,
    pub(crate) evaluation: String,
    pub(crate) design_request: String,
    pub(crate) layout: String,
}

/// Requests `path` until the response meets the condition, and returns that response.
async fn wait_for_response(api: &ApiClient, path: &str, is_met: impl Fn(&Value) -> bool) -> Value {
    wait_for(path, async || Some(api.get(path).await.expect(200)).filter(&is_met)).await
}

/// Creates a run and fills it: results, columns, critiques, layouts, an evaluation, rollouts, versions and tags.
pub(crate) async fn create_populated_run(api: &ApiClient, id: &str) -> PopulatedRun {
    let run = format!("/v1/runs/{id}");
    let request = json!({
        "strategy": "ladder", "id": id, "name": format!("the run {id}"), "seed": 11, "group_size": 2, "placement": false,
        "contested_share": 1.0, "target": "mastery", "tasks": [TASK], "tags": ["first", "second"],
    });
    let _ = api.post("/v1/runs", request).await.expect(201);
    let lease = api.lease(id, json!({"groups": 24})).await;
    api.report(id, lease.results("hold")).await;
    wait_for_response(api, &run, |run| run["critique_backlog"]["waiting"] == 0).await;
    let (design_request, layout) = request_designs(api, &run).await;

    let columns = ColumnClaim::new(api, id, json!({"groups": 4}), "hold").await;
    let claim = columns.claim(api).await;
    api.report(id, columns.audited_results(&claim)).await;
    let mut refuted = ColumnClaim::new(api, id, json!({"groups": 2}), "hold").await;
    refuted.scores.iter_mut().for_each(|score| *score = 0.5);
    let claim = refuted.claim(api).await;
    api.report(id, refuted.audited_results(&claim)).await;
    assert_eq!(api.get(&run).await.expect(200)["warnings"]["count"], 1, "the refused claim");
    let evaluation = evaluate(api, id).await;

    let _ =
        api.post(&format!("{run}/metrics"), json!({"step": 1, "metrics": {"loss": 0.5}})).await.expect(200);
    let version = json!({"checkpoint": "weights-1"});
    let _ = api.send_json("PUT", &format!("{run}/policy_versions/1"), version).await.expect(200);
    let policy = json!({"policy": "hold", "max_unacknowledged_groups": 2});
    let _ = api.send_json("PUT", &format!("{run}/policy"), policy).await.expect(200);
    wait_for_response(api, &format!("{run}/policy"), |policy| policy["feed"]["full"] == true).await;
    let _ = api.lease(id, json!({"groups": 2})).await; // stays active
    PopulatedRun {
        lease: lease.id().to_owned(),
        columns: columns.lease.id().to_owned(),
        episode: lease.episodes()[0].0.clone(),
        evaluation,
        design_request,
        layout,
    }
}

/// Requests layouts of a run. Returns the ids of the request and of a layout.
async fn request_designs(api: &ApiClient, run: &str) -> (String, String) {
    let _ = api.post(&format!("{run}/designs"), json!({"count": 2})).await.expect(202);
    let designs = format!("{run}/designs");
    let designs = wait_for_response(api, &designs, |page| page["designs"][0]["id"].is_string()).await;
    let ended = |page: &Value| {
        page["requests"].as_array().unwrap().iter().all(|request| request["ended_at"].is_string())
    };
    let requests = wait_for_response(api, &format!("{run}/designs/requests"), ended).await;
    let id = |value: &Value| value["id"].as_str().unwrap().to_owned();
    (id(&requests["requests"][0]), id(&designs["designs"][0]))
}

/// Starts an evaluation and reports two of its scenarios. Returns its id.
async fn evaluate(api: &ApiClient, run: &str) -> String {
    let request = json!({"policy": "mine", "run": run, "rollouts": 1, "tasks": [TASK]});
    let id = api.post("/v1/evaluations", request).await.expect(201)["id"].as_str().unwrap().to_owned();
    let lease = api.lease(run, json!({"groups": 2, "purpose": "eval", "evaluation": id})).await;
    api.report(run, lease.results("hold")).await;
    let evaluation = api.get(&format!("/v1/evaluations/{id}")).await.expect(200);
    assert_eq!(evaluation["scenarios_done"], 2, "{evaluation}");
    id
}
