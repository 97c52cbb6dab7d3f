//! Disclosure of plans and critiques by the state of the group and by the role of the client's token.

use env_core::Scenario;
use serde_json::json;
use system_tests::Server;

use super::{
    KnownGroup, TASK, assert_complete, assert_refused, assert_withheld, create_run, critique,
    has_avoiding_action, replay,
};
use crate::access::start_with_tokens;

#[tokio::test]
async fn plan_is_withheld_while_siblings_are_open() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 4})).await;
    let group = KnownGroup::find(&api.lease("run", json!({"groups": 16})).await);
    let first = &group.episodes[0];
    group.report(&api, "run", 0..1).await;
    for reported in 1..4 {
        assert_refused(&replay(&api, "run", first, "reference").await, 409, "scenario_in_use", "open group");
        assert_withheld(&critique(&api, "run", first).await, "open group");
        group.report(&api, "run", reported..reported + 1).await;
    }
    for plan in ["agent", "hold"] {
        let _ = replay(&api, "run", first, plan).await.expect(200);
    }
    // The group is closed: the plan is that of the planner.
    let shown = replay(&api, "run", first, "reference").await.expect(200);
    let score = shown["frames"].as_array().unwrap().last().unwrap()["state"]["total_score"].clone();
    let bracket = group.scenario.task().bracket(&group.scenario).unwrap();
    assert!((score.as_f64().unwrap() - bracket.reference.score).abs() < 1e-9, "{score}");
    assert_complete(&critique(&api, "run", first).await);
}

#[tokio::test(flavor = "multi_thread")]
async fn trainer_tokens_read_no_plan() {
    let (server, tokens) = start_with_tokens(|config| config).await;
    let [viewer, trainer, admin] =
        ["viewer", "trainer", "admin"].map(|role| server.api().with_token(&tokens[role]));
    create_run(&trainer, "run", json!({})).await;
    let group = KnownGroup::find(&trainer.lease("run", json!({"groups": 16})).await);
    let first = &group.episodes[0];
    group.report(&trainer, "run", 0..1).await;
    for api in [&viewer, &admin] {
        assert_refused(&replay(api, "run", first, "reference").await, 409, "scenario_in_use", "open group");
        assert_withheld(&critique(api, "run", first).await, "open group");
    }
    group.report(&trainer, "run", 1..2).await;
    let refused = replay(&trainer, "run", first, "reference").await;
    assert_refused(&refused, 403, "forbidden", "use a token with the role viewer or admin");
    assert_withheld(&critique(&trainer, "run", first).await, "the role viewer or admin");
    for api in [&viewer, &admin] {
        let _ = replay(api, "run", first, "reference").await.expect(200);
        assert_complete(&critique(api, "run", first).await);
    }
    // Scenarios that users write have the same rule.
    let mut drawn = (0..).map(|seed| json!({"task": TASK, "seed": seed, "params": {"debris": 60}}));
    let scenario = drawn.find(|json| has_avoiding_action(&Scenario::from_json(json).unwrap())).unwrap();
    let request = json!({"scenario": scenario, "actions": {"steps": [], "stopped": "too_late"}});
    let checked = trainer.post("/v1/scenarios", request.clone()).await.expect(200);
    assert_withheld(&checked["critique"], "the role viewer or admin");
    assert_complete(&admin.post("/v1/scenarios", request).await.expect(200)["critique"]);
}

/// The trajectories of such a policy would be plans.
#[tokio::test]
async fn server_does_not_roll_out_the_planner() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let refused =
        api.send_json("PUT", "/v1/runs/run/policy", json!({"policy": "reference"})).await.expect(422);
    assert_eq!(refused["field"], "policy");
    assert!(refused["detail"].as_str().unwrap().contains("POST /v1/evaluations"), "{refused}");
    let unknown = api.send_json("PUT", "/v1/runs/run/policy", json!({"policy": "best"})).await.expect(422);
    let detail = unknown["detail"].as_str().unwrap();
    assert!(detail.contains("heuristic") && !detail.contains("reference"), "{detail}");
}
