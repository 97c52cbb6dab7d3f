//! Sessions that run episodes of a curriculum: whose steps a log has, and which policy version an episode has.

use serde_json::{Value, json};
use system_tests::{ApiClient, Received, Server, http_client};

use super::socket::OpenEnvSocket;

fn hold() -> Value {
    json!({"burns": []})
}

/// In a shared session, the steps of two rollouts would alternate in one log.
#[tokio::test(flavor = "multi_thread")]
async fn episodes_of_runs_need_sessions_of_their_own() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"id": "run", "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let lease = api.lease("run", json!({"groups": 1})).await; // waits until scenarios are prepared
    let in_lease = json!({"run": "run", "lease_id": lease.id()});
    for body in [json!({"run": "run"}), in_lease] {
        let refused = api.post("/reset", body.clone()).await.expect(422);
        assert_eq!(refused["detail"][0]["loc"], json!(["header", "X-Session-Id"]), "{refused}");
        // A cookie jar is shared by the rollouts of a client.
        let with_cookie = http_client()
            .post(format!("{}/reset", api.base()))
            .header("cookie", "sparring_session=jar")
            .json(&body);
        assert_eq!(with_cookie.send().await.unwrap().status(), 422);
    }
    assert_eq!(api.post("/step", hold()).await.status, 409, "no episode is running");
    // Rollouts at the same time, each with its own session, all end and are reported.
    let rollouts = (0..4).map(|n| {
        let api = api.clone().with_session(&format!("rollout-{n}"));
        tokio::spawn(async move {
            let _ = api.post("/reset", json!({"run": "run"})).await.expect(200);
            let mut steps = 0;
            loop {
                let stepped = api.post("/step", hold()).await.expect(200);
                steps += 1;
                if stepped["done"] == true {
                    break;
                }
            }
            assert!(steps <= 50, "{steps}");
            api.get("/state").await.expect(200)["reported"]["status"].clone()
        })
    });
    for rollout in rollouts.collect::<Vec<_>>() {
        assert_eq!(rollout.await.unwrap(), "counted");
    }
}

/// A second reset in the same session ends the first episode. A step that names the first one changes nothing.
#[tokio::test(flavor = "multi_thread")]
async fn step_of_another_reset_is_refused() {
    let server = Server::start().await;
    let api = server.api().with_session("shared");
    let settings = json!({"id": "run", "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let reset = async || {
        let _ = api.post("/reset", json!({"run": "run"})).await.expect(200);
        api.get("/state").await.expect(200)["episode_id"].as_str().unwrap().to_owned()
    };
    let (first, second) = (reset().await, reset().await);
    let step = |episode: &str| json!({"burns": [], "episode_id": episode});
    let refused = api.post("/step", step(&first)).await.expect(409);
    assert!(refused.to_string().contains(&second), "{refused}");
    assert_eq!(api.get("/state").await.expect(200)["step_count"], 0);
    let _ = api.post("/step", step(&second)).await.expect(200);
    let _ = api.post("/step", json!({"action": {"burns": []}, "episode_id": second})).await.expect(200);
}

/// Runs an episode of group `g` to its end, with a version of the policy.
async fn run_sibling(api: &ApiClient, version: u32) {
    let mut socket = OpenEnvSocket::connect(api, "/ws").await;
    let _ = socket.reset(json!({"run": "run", "group_id": "g", "policy_version": version})).await;
    for _ in 0..60 {
        if socket.step(hold()).await["done"] == true {
            break;
        }
    }
    assert_eq!(socket.state().await["reported"]["status"], "counted");
}

#[tokio::test(flavor = "multi_thread")]
async fn siblings_keep_their_own_policy_versions() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"id": "run", "tasks": ["kessler/survival"], "group_size": 4, "max_staleness": 2,
        "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let _ = api.lease("run", json!({"groups": 1})).await; // waits until scenarios are prepared
    run_sibling(&api, 1).await;
    // Another size than that of the open group is refused.
    let mut socket = OpenEnvSocket::connect(&api, "/ws").await;
    let data = json!({"run": "run", "group_id": "g", "group_size": 8, "policy_version": 1});
    let refused = socket.request(&json!({"type": "reset", "data": data})).await;
    let message = refused["data"]["message"].as_str().unwrap();
    assert!(message.contains("group_size") && message.contains("must be 4"), "{refused}");
    run_sibling(&api, 5).await;
    let stored = api.get("/v1/runs/run/episodes").await.expect(200);
    let mut versions: Vec<i64> = stored["episodes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|e| e["policy_version"].as_i64().unwrap())
        .collect();
    versions.sort_unstable();
    assert_eq!(versions, [1, 5]);
    // With a version of its lease's own, a session of a lease keeps it too.
    let lease = api.lease("run", json!({"groups": 1, "policy_version": 5})).await;
    let _ = socket.reset(json!({"run": "run", "lease_id": lease.id(), "policy_version": 6})).await;
    while socket.step(hold()).await["done"] != true {}
    let stored = api.get("/v1/runs/run/episodes").await.expect(200);
    assert!(stored["episodes"].as_array().unwrap().iter().any(|episode| episode["policy_version"] == 6));
}

#[tokio::test]
async fn fields_of_a_reset_in_a_query_are_refused() {
    let server = Server::start().await;
    let api = server.api();
    for query in ["run=r", "run_id=r", "task=rendezvous&seed=5", "x=1&seed=5"] {
        let reset = api.post(&format!("/reset?{query}"), json!({})).await;
        assert!(reset.expect(422)["detail"].to_string().contains("must be sent in the data of a reset"));
        let mut socket = OpenEnvSocket::connect(&api, &format!("/ws?{query}")).await;
        let Received::Text(frame) = socket.receive().await else { panic!("no frame") };
        assert_eq!(frame["data"]["code"], "VALIDATION_ERROR", "{frame}");
    }
    let _ = api.post("/reset?x=1", json!({})).await.expect(200);
}
