//! Bodies of policies and groups, their formats, and invalid requests.

use serde_json::{Value, json};
use system_tests::{ApiClient, Server, http_client, wait_for};

use super::{claim, create_run, put_policy, wait_for_full_feed};

/// Requests a URL with this `Accept` header; returns status, content type and body.
async fn request_with_accept(url: &str, accept: &str) -> (u16, String, Vec<u8>) {
    let response = http_client().get(url).header("accept", accept).send().await.unwrap();
    let content_type = response.headers()["content-type"].to_str().unwrap().to_owned();
    (response.status().as_u16(), content_type, response.bytes().await.unwrap().to_vec())
}

#[tokio::test]
async fn all_formats_have_the_same_content() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let _ = put_policy(&api, "run", json!({"policy": "random", "max_unacknowledged_groups": 3}))
        .await
        .expect(200);
    wait_for_full_feed(&api, "run").await;
    let url = |path: &str| format!("{}/v1/runs/{path}", api.base());
    let (_, content_type, json) = request_with_accept(&url("run/trajectories?after=0"), "*/*").await;
    assert_eq!(content_type, "application/json");
    let json: Value = serde_json::from_slice(&json).unwrap();
    assert_eq!(json["groups"].as_array().unwrap().len(), 3);
    let (_, content_type, packed) =
        request_with_accept(&url("run/trajectories?after=0"), "application/msgpack").await;
    assert_eq!(content_type, "application/msgpack");
    assert_eq!(rmp_serde::from_slice::<Value>(&packed).unwrap(), json);
    let (_, content_type, lines) =
        request_with_accept(&url("run/trajectories?after=0"), "application/x-ndjson").await;
    assert_eq!(content_type, "application/x-ndjson");
    let lines = String::from_utf8(lines).unwrap();
    let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(Value::Array(lines), json["groups"]);
    // All routes under /v1 support MessagePack, for problems too.
    for path in
        ["run", "run/mastery", "run/policy", "run/leases", "unknown", "run/trajectories?limit=0", "a/b/c/d"]
    {
        // Workers may change a response between two requests: compare when it is the same before and after.
        wait_for("the response does not change", async || {
            let (plain, content_type, json) = request_with_accept(&url(path), "application/json").await;
            let (status, packed_kind, packed) = request_with_accept(&url(path), "application/msgpack").await;
            assert_eq!(
                (status, packed_kind.as_str()),
                (plain, "application/msgpack"),
                "{path}: {content_type}"
            );
            let (_, _, again) = request_with_accept(&url(path), "application/json").await;
            let json: Value = serde_json::from_slice(&json).unwrap();
            let is_stable = serde_json::from_slice::<Value>(&again).unwrap() == json;
            is_stable.then(|| assert_eq!(rmp_serde::from_slice::<Value>(&packed).unwrap(), json, "{path}"))
        })
        .await;
    }
    let (_, content_type, _) =
        request_with_accept(&format!("{}/health", api.base()), "application/msgpack").await;
    assert_eq!(content_type, "application/json", "OpenEnv's routes return JSON only");
}

#[tokio::test]
async fn bodies_match_snapshots() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 2, "seed": 9})).await;
    insta::assert_json_snapshot!("no_policy", super::policy(&api, "run").await);
    let request = json!({"policy": "hold", "version": 2, "max_unacknowledged_groups": 1, "temperature": 0.5, "history": 1, "max_tokens": 64});
    let set = put_policy(&api, "run", request).await.expect(200);
    insta::assert_json_snapshot!("policy", set, {".changed_at" => "[time]", ".groups" => "[n]", ".episodes" => "[n]",
        ".feed" => "[feed]"});
    let mut groups = claim(&api, "run", json!({"wait_s": 30})).await;
    let group = &mut groups[0];
    for episode in group["episodes"].as_array_mut().unwrap() {
        let steps = episode["steps"].as_array_mut().unwrap();
        for step in steps.iter_mut() {
            truncate_lists(&mut step["observation"]);
        }
        steps.drain(1..steps.len() - 1);
        truncate_lists(&mut episode["last_observation"]);
    }
    insta::assert_json_snapshot!("group", group, {".lease" => "[lease]", ".episodes[].id" => "[episode]"});
}

/// Shortens each list of an observation to its first item.
fn truncate_lists(observation: &mut Value) {
    for field in observation.as_object_mut().unwrap().values_mut() {
        if let Value::Array(items) = field {
            items.truncate(1);
        }
    }
}

#[tokio::test]
async fn invalid_requests_are_rejected_with_a_reason() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"tasks": ["kessler/survival", "docking/single"]})).await;
    let mut problems = Vec::new();
    for request in [
        json!({}),
        json!({"policy": "wanderer"}),
        json!({"policy": "chat"}),
        // A request cannot set the endpoint.
        json!({"policy": "chat", "url": "http://169.254.169.254/latest"}),
        json!({"policy": "chat", "base_url": "http://127.0.0.1:1/v1", "model": "m"}),
        json!({"policy": "http://127.0.0.1:1/v1"}),
        json!({"policy": "hold", "version": -1}),
        json!({"policy": "hold", "temperature": 5.1}),
        json!({"policy": "hold", "history": 65}),
        json!({"policy": "hold", "max_tokens": 1}),
        json!({"policy": "hold", "max_unacknowledged_groups": 0}),
        json!({"policy": "hold", "observations": "tracks"}),
    ] {
        let response = put_policy(&api, "run", request.clone()).await;
        assert_eq!(response.content_type, "application/problem+json");
        problems.push(json!({"put": request, "problem": response.body}));
    }
    problems.extend(feed_problems(&api).await);
    for request in [json!({}), json!({"ids": [-1]}), json!({"ids": vec![1; 10_001]}), json!({"ids": "all"})] {
        let response = api.post("/v1/runs/run/trajectories/ack", request).await;
        problems.push(json!({"ack": "…", "problem": response.body}));
    }
    for (method, path) in [
        ("GET", "policy"),
        ("PUT", "policy"),
        ("GET", "trajectories"),
        ("POST", "trajectories/claim"),
        ("POST", "trajectories/ack"),
    ] {
        let body = match path {
            "policy" => json!({"policy": "chat"}),
            "trajectories/ack" => json!({"ids": []}),
            _ => json!({}),
        };
        let response = api
            .request(method, &format!("/v1/runs/unknown/{path}"), "application/json", body.to_string())
            .await;
        assert_eq!(
            (response.status, &response.body["type"]),
            (404, &json!("urn:sparring:problem:unknown_run"))
        );
    }
    insta::assert_json_snapshot!("problems", problems);
    assert_eq!(super::policy(&api, "run").await["policy"], "off", "no invalid policy was stored");
}

/// Problems of requests that read or claim groups, with their requests.
async fn feed_problems(api: &ApiClient) -> Vec<Value> {
    let mut problems = Vec::new();
    for query in ["limit=0", "limit=257", "wait_s=61", "after=-1", "ttl_s=5", "cursor=3"] {
        let response = api.get(&format!("/v1/runs/run/trajectories?{query}")).await;
        problems.push(json!({"query": query, "problem": response.body}));
    }
    for request in [
        json!({"limit": 0}),
        json!({"limit": 257}),
        json!({"wait_s": 61}),
        json!({"ttl_s": 0}),
        json!({"ttl_s": 86_401}),
        json!({"after": 1}),
        json!([]),
    ] {
        let response = api.post("/v1/runs/run/trajectories/claim", request.clone()).await;
        problems.push(json!({"claim": request, "problem": response.body}));
    }
    problems
}
