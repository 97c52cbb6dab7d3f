//! What bodies look like, in which forms, and what is refused.

use serde_json::{Value, json};
use system_tests::{Server, http_client};

use super::{pull, put, run, until};

/// An answer in the form that is asked for.
async fn told(url: &str, accept: &str) -> (u16, String, Vec<u8>) {
    let response = http_client().get(url).header("accept", accept).send().await.unwrap();
    let kind = response.headers()["content-type"].to_str().unwrap().to_owned();
    (response.status().as_u16(), kind, response.bytes().await.unwrap().to_vec())
}

#[tokio::test]
async fn all_forms_of_an_answer_say_the_same() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({})).await;
    let _ = put(&api, "run", json!({"policy": "random", "ahead": 3})).await.expect(200);
    until(&api, "run", "full", |told| told["feed"]["full"] == true).await;
    let url = |path: &str| format!("{}/v1/runs/{path}", api.base());
    let (_, kind, json) = told(&url("run/trajectories?after=0"), "*/*").await;
    assert_eq!(kind, "application/json");
    let json: Value = serde_json::from_slice(&json).unwrap();
    assert_eq!(json["groups"].as_array().unwrap().len(), 3);
    let (_, kind, packed) = told(&url("run/trajectories?after=0"), "application/msgpack").await;
    assert_eq!(kind, "application/msgpack");
    assert_eq!(rmp_serde::from_slice::<Value>(&packed).unwrap(), json);
    let (_, kind, lines) = told(&url("run/trajectories?after=0"), "application/x-ndjson").await;
    assert_eq!(kind, "application/x-ndjson");
    let lines = String::from_utf8(lines).unwrap();
    let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(Value::Array(lines), json["groups"]);
    // Everything under /v1 can be had so, refusals too.
    for path in
        ["run", "run/mastery", "run/policy", "run/leases", "nobody", "run/trajectories?limit=0", "a/b/c/d"]
    {
        let (plain, kind, json) = told(&url(path), "application/json").await;
        let (status, packed_kind, packed) = told(&url(path), "application/msgpack").await;
        assert_eq!((status, packed_kind.as_str()), (plain, "application/msgpack"), "{path}: {kind}");
        let json: Value = serde_json::from_slice(&json).unwrap();
        assert_eq!(rmp_serde::from_slice::<Value>(&packed).unwrap(), json, "{path}");
    }
    let (_, kind, _) = told(&format!("{}/health", api.base()), "application/msgpack").await;
    assert_eq!(kind, "application/json", "OpenEnv's routes are as they were");
}

#[tokio::test]
async fn bodies_are_what_they_were() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({"group_size": 2, "seed": 9})).await;
    insta::assert_json_snapshot!("no_policy", super::policy(&api, "run").await);
    let wish = json!({"policy": "hold", "version": 2, "ahead": 1, "temperature": 0.5, "history": 1, "max_tokens": 64});
    let set = put(&api, "run", wish).await.expect(200);
    insta::assert_json_snapshot!("policy", set, {".changed_at" => "[time]", ".groups" => "[n]", ".episodes" => "[n]",
        ".feed" => "[feed]"});
    let mut groups = pull(&api, "run", "wait_s=30").await;
    let group = &mut groups[0];
    for episode in group["episodes"].as_array_mut().unwrap() {
        let steps = episode["steps"].as_array_mut().unwrap();
        for step in steps.iter_mut() {
            shorten(&mut step["observation"]);
        }
        steps.drain(1..steps.len() - 1);
        shorten(&mut episode["last_observation"]);
    }
    insta::assert_json_snapshot!("group", group, {".lease" => "[lease]", ".episodes[].id" => "[episode]"});
}

/// The first of each list of an observation says what the others look like.
fn shorten(observation: &mut Value) {
    for field in observation.as_object_mut().unwrap().values_mut() {
        if let Value::Array(items) = field {
            items.truncate(1);
        }
    }
}

#[tokio::test]
async fn what_cannot_be_is_refused_in_plain_words() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({"tasks": ["kessler/survival", "docking/single"]})).await;
    let mut problems = Vec::new();
    for wish in [
        json!({}),
        json!({"policy": "wanderer"}),
        json!({"policy": "chat"}),
        // No body can name an endpoint.
        json!({"policy": "chat", "url": "http://169.254.169.254/latest"}),
        json!({"policy": "chat", "base_url": "http://127.0.0.1:1/v1", "model": "m"}),
        json!({"policy": "http://127.0.0.1:1/v1"}),
        json!({"policy": "hold", "version": -1}),
        json!({"policy": "hold", "temperature": 5.1}),
        json!({"policy": "hold", "history": 65}),
        json!({"policy": "hold", "max_tokens": 1}),
        json!({"policy": "hold", "ahead": 0}),
        json!({"policy": "hold", "observations": "tracks"}),
    ] {
        let told = put(&api, "run", wish.clone()).await;
        assert_eq!(told.kind, "application/problem+json");
        problems.push(json!({"put": wish, "problem": told.body}));
    }
    for query in [
        "limit=0",
        "limit=257",
        "wait_s=61",
        "ttl_s=0",
        "ttl_s=86401",
        "after=-1",
        "after=1&ttl_s=5",
        "cursor=3",
    ] {
        let told = api.get(&format!("/v1/runs/run/trajectories?{query}")).await;
        problems.push(json!({"query": query, "problem": told.body}));
    }
    for wish in [json!({}), json!({"ids": [-1]}), json!({"ids": vec![1; 10_001]}), json!({"ids": "all"})] {
        let told = api.post("/v1/runs/run/trajectories/ack", wish).await;
        problems.push(json!({"ack": "…", "problem": told.body}));
    }
    for (method, path) in
        [("GET", "policy"), ("PUT", "policy"), ("GET", "trajectories"), ("POST", "trajectories/ack")]
    {
        let body = if path == "policy" { json!({"policy": "chat"}) } else { json!({"ids": []}) };
        let told =
            api.raw(method, &format!("/v1/runs/nobody/{path}"), "application/json", body.to_string()).await;
        assert_eq!((told.status, &told.body["type"]), (404, &json!("urn:sparring:problem:unknown_run")));
    }
    insta::assert_json_snapshot!("problems", problems);
    assert_eq!(super::policy(&api, "run").await["policy"], "off", "nothing of it was kept");
}
