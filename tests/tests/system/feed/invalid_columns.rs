//! Invalid columns: each is rejected with its field and leaves the lease unclaimed.

use serde_json::{Value, json};
use system_tests::{ApiResponse, IncompletePost, Server};

use super::column_trainer::{ColumnClaim, create_run};

/// Encodes a MessagePack map from keys and encoded values.
fn encode_map(entries: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = vec![0x80 | entries.len() as u8];
    for (key, value) in entries {
        bytes.push(0xa0 | key.len() as u8);
        bytes.extend_from_slice(key.as_bytes());
        bytes.extend_from_slice(value);
    }
    bytes
}

fn encode_binary(bytes: &[u8]) -> Vec<u8> {
    [&[0xc6], &(bytes.len() as u32).to_be_bytes()[..], bytes].concat()
}

fn encode_floats(scores: &[f32]) -> Vec<u8> {
    encode_binary(&scores.iter().flat_map(|score| score.to_le_bytes()).collect::<Vec<u8>>())
}

fn problem_fields(response: &ApiResponse) -> (u16, String, String) {
    let text = |key: &str| response.body[key].as_str().unwrap_or_default().to_owned();
    (response.status, text("field"), text("detail"))
}

/// Starts a server with two runs, and runs six episodes of a lease of columns.
async fn start_with_episodes() -> (Server, ColumnClaim) {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"audit_groups": 4})).await;
    create_run(&api, "other", json!({})).await;
    let trainer = ColumnClaim::new(&api, "run", json!({"groups": 6}), "hold").await;
    (server, trainer)
}

#[tokio::test]
async fn invalid_json_columns_are_rejected_by_field() {
    let (server, trainer) = start_with_episodes().await;
    let (api, path, scores) = (server.api(), trainer.path(), trainer.scores.clone());
    let mut high = scores.clone();
    high[2] = 1.5;
    let cases = [
        (json!({"score": &scores[..5]}), 422, "score", "got 5"),
        (json!({"score": high}), 422, "score.2", "0.001 to 0.999"),
        (json!({"score": scores, "steps": [1, 2]}), 422, "steps", "got 2"),
        (json!({"score": scores, "failed": [0, 0, 2, 0, 0, 0]}), 422, "failed.2", "0 or 1"),
        (json!({"score": scores, "failed": [0, 0, -1, 0, 0, 0]}), 422, "failed.2", "0 or 1"),
        (json!({"score": scores, "steps": [1, 1, 1.5, 1, 1, 1]}), 422, "steps.2", "integer"),
        (json!({"score": [0.1, "x", 0.1, 0.1, 0.1, 0.1]}), 422, "score.1", "a finite number"),
        (json!({"score": [0.1, null, 0.1, 0.1, 0.1, 0.1]}), 422, "score.1", "a finite number"),
        (json!({"score": "all fine"}), 422, "score", "list"),
        (json!({"score": 7}), 422, "score", "list"),
        (json!({"score": {}}), 422, "score", "list"),
        (json!({}), 422, "score", "required"),
        (
            json!({"score": scores, "scores": scores}),
            422,
            "scores",
            "the known fields are policy_version, score, failed, steps",
        ),
        (json!({"score": scores, "policy_version": -1}), 422, "policy_version", "integer"),
        (json!({"score": scores, "policy_version": "1"}), 422, "policy_version", "integer"),
        (json!([scores]), 422, "", ""),
        (json!({"score": vec![0.5; 100_001]}), 422, "score", "100000"),
    ];
    for (body, status, field, text) in cases {
        let response = api.post(&path, body.clone()).await;
        let (found, at, detail) = problem_fields(&response);
        assert_eq!(found, status, "{body} {response:?}");
        assert!(at.starts_with(field) && detail.contains(text), "{at}: {detail} (for {field}: {text})");
    }
    for text in ["", "{", "{\"score\": [1,}", "{\"score\": [NaN]}", "{\"score\": [1e999]}", "\u{0}"] {
        let response = api.request("POST", &path, "application/json", text.to_owned()).await;
        assert!([400, 422].contains(&response.status), "{text}: {response:?}");
    }
    let plain = api.request("POST", &path, "text/plain", "score").await;
    assert_eq!(plain.status, 415);
}

#[tokio::test]
async fn invalid_msgpack_columns_are_rejected_by_field() {
    let (server, trainer) = start_with_episodes().await;
    let (api, path, scores) = (server.api(), trainer.path(), trainer.scores.clone());
    let single: Vec<f32> = scores.iter().map(|score| *score as f32).collect();
    let mut nan = single.clone();
    nan[4] = f32::NAN;
    let bomb = |count: u32| [&[0xdd], &count.to_be_bytes()[..]].concat();
    let deep = [vec![0x91; 5000], vec![0xc0]].concat();
    let cases = [
        (encode_map(&[("score", encode_floats(&nan))]), 422, "score.4"),
        (encode_map(&[("score", encode_binary(&[0; 23]))]), 422, "score"),
        (encode_map(&[("score", encode_floats(&single[..3]))]), 422, "score"),
        (encode_map(&[("score", encode_floats(&single)), ("failed", encode_binary(&[0; 5]))]), 422, "failed"),
        (encode_map(&[("score", bomb(u32::MAX))]), 400, "body"),
        (encode_map(&[("score", [bomb(2_000_000), vec![0xca; 16]].concat())]), 400, "body"),
        (encode_map(&[("score", [vec![0xc6], u32::MAX.to_be_bytes().to_vec()].concat())]), 400, "body"),
        (encode_map(&[("score", deep.clone())]), 400, "body"),
        (deep, 400, "body"),
        ([encode_map(&[("score", encode_floats(&single))]), vec![0]].concat(), 400, "body"),
        (vec![], 400, "body"),
        (vec![0xc1], 400, "body"),
    ];
    for (at, (body, status, field)) in cases.into_iter().enumerate() {
        let response = api.request("POST", &path, "application/msgpack", body).await;
        let (found, named, detail) = problem_fields(&response);
        assert!(found == status || (status == 400 && found == 422), "{at}: {response:?}");
        assert!(named.starts_with(field) || status == 400, "{at}: {named}: {detail}");
    }
    // Claims for another run, for a lease of groups, and a lease without a claim.
    let body = json!({"score": scores});
    let foreign = path.replace("/run/", "/other/");
    assert_eq!(
        api.post(&foreign, body.clone()).await.expect(404)["type"],
        "urn:sparring:problem:unknown_lease"
    );
    let groups = api.lease("run", json!({"groups": 2})).await;
    let wrong = format!("/v1/runs/run/leases/{}/columns", groups.id());
    assert_eq!(api.post(&wrong, body.clone()).await.expect(422)["field"], "lease");
    assert_eq!(api.get(&path).await.expect(404)["type"], "urn:sparring:problem:no_columns");
    // No invalid claim was stored: the same lease accepts a valid claim in MessagePack.
    let steps: Vec<u8> = trainer.logs.iter().flat_map(|log| (log.len() as u32).to_le_bytes()).collect();
    let right = encode_map(&[
        ("score", encode_floats(&single)),
        ("steps", encode_binary(&steps)),
        ("failed", encode_binary(&[0; 6])),
    ]);
    let claim = api.request("POST", &path, "application/msgpack", right).await.expect(200);
    assert_eq!((&claim["state"], &claim["episodes"]), (&json!("claimed"), &json!(6)));
    let _ = api.report("run", trainer.audited_results(&claim)).await;
    assert_eq!(trainer.claim_state(&api).await["state"], "accepted");
}

/// Incomplete bodies, also more large ones than the server reads at a time, do not block other requests.
#[tokio::test]
async fn incomplete_bodies_do_not_block_other_requests() {
    let (server, trainer) = start_with_episodes().await;
    let (api, path) = (server.api(), trainer.path());
    let mut incomplete = Vec::new();
    for length in [8_000_000, 8_000_000, 8_000_000, 8_000_000, 100, 100, 100, 100] {
        let mut post = IncompletePost::send_head(&api, &path, length).await;
        // The server reads the first large body and all small ones; the other large ones may have to wait.
        if incomplete.is_empty() || length == 100 {
            post.send_first_byte().await;
        }
        incomplete.push(post);
    }
    let claim = api.post(&path, json!({"score": trainer.scores})).await.expect(200);
    let _ = api.report("run", trainer.audited_results(&claim)).await;
    assert_eq!(trainer.claim_state(&api).await["state"], "accepted");
    // These requests did not wait for the timeout of the incomplete bodies.
    assert!(incomplete[4..].iter().all(IncompletePost::is_pending));
}

#[tokio::test]
async fn invalid_column_leases_are_rejected() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let cases = [
        (json!({"groups": 0}), "groups"),
        (json!({"groups": 100_001}), "groups"),
        (json!({"groups": 50_000, "group_size": 3}), "groups"),
        (json!({"groups": 4_294_967_295u32, "group_size": 1024}), "groups"),
        (json!({"groups": 10, "purpose": "eval"}), "form"),
        (json!({"groups": 10, "ttl_s": 0}), "ttl_s"),
        (json!({"groups": 10, "form": "rows"}), "form"),
    ];
    for (body, field) in cases {
        let mut lease_request = json!({"form": "columns"});
        lease_request.as_object_mut().unwrap().extend(body.as_object().unwrap().clone());
        let rejected: Value = api.post("/v1/runs/run/leases", lease_request).await.expect(422);
        assert_eq!(rejected["field"], field, "{rejected}");
    }
    let rejected = api.post("/v1/runs", json!({"strategy": "ladder", "audit_groups": 0})).await.expect(422);
    assert_eq!(rejected["field"], "audit_groups");
    // The largest possible lease.
    let lease = api.lease("run", json!({"form": "columns", "groups": 100_000})).await;
    assert_eq!(lease.0["ranges"].as_array().unwrap().len(), 64);
    assert!(lease.0.to_string().len() < 100_000, "the response of a lease of 100 000 episodes is small");
}

/// Requests may be encoded in MessagePack.
#[tokio::test]
async fn requests_may_be_msgpack() {
    let server = Server::start().await;
    let api = server.api();
    let body = encode_map(&[("id", b"\xa3abc".to_vec()), ("group_size", vec![2])]);
    let run = api.request("POST", "/v1/runs", "application/msgpack", body).await.expect(201);
    assert_eq!((&run["id"], &run["settings"]["group_size"]), (&json!("abc"), &json!(2)));
    let twice = encode_map(&[("id", b"\xa3abd".to_vec()), ("id", b"\xa3abe".to_vec())]);
    let rejected = api.request("POST", "/v1/runs", "application/msgpack", twice).await.expect(422);
    assert_eq!(rejected["field"], "id");
    for bytes in [
        vec![0xc1],
        vec![0x81, 0x01, 0x02],
        encode_map(&[("id", vec![0xc4, 1, 0])]),
        vec![0xdf, 255, 255, 255, 255],
    ] {
        let rejected = api.request("POST", "/v1/runs", "application/msgpack", bytes).await;
        assert!([400, 422].contains(&rejected.status), "{rejected:?}");
    }
    // Values of one byte each: more than the server accepts.
    let many = [vec![0xdd, 0, 0x60, 0, 0], vec![0xc0; 0x60_0000]].concat();
    let rejected = api.request("POST", "/v1/runs/abc/results", "application/msgpack", many).await;
    assert!([400, 413].contains(&rejected.status), "{rejected:?}");
}
