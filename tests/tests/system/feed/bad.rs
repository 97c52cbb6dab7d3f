//! Columns that cannot be: each is told by its field, and nothing is kept of it.

use serde_json::{Value, json};
use system_tests::{Answer, Server};

use super::trainer::{Flight, run};

/// A map of MessagePack with these entries, their values packed already.
fn packed(entries: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = vec![0x80 | entries.len() as u8];
    for (key, value) in entries {
        bytes.push(0xa0 | key.len() as u8);
        bytes.extend_from_slice(key.as_bytes());
        bytes.extend_from_slice(value);
    }
    bytes
}

fn bin(bytes: &[u8]) -> Vec<u8> {
    [&[0xc6], &(bytes.len() as u32).to_be_bytes()[..], bytes].concat()
}

fn floats(scores: &[f32]) -> Vec<u8> {
    bin(&scores.iter().flat_map(|score| score.to_le_bytes()).collect::<Vec<u8>>())
}

fn told(answer: &Answer) -> (u16, String, String) {
    let word = |key: &str| answer.body[key].as_str().unwrap_or_default().to_owned();
    (answer.status, word("field"), word("detail"))
}

/// A server with two runs, and six episodes that were flown for one of them.
async fn flown() -> (Server, Flight) {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({"audit_groups": 4})).await;
    run(&api, "other", json!({})).await;
    let flight = Flight::new(&api, "run", json!({"groups": 6}), "hold").await;
    (server, flight)
}

#[tokio::test]
async fn columns_that_cannot_be_are_told_by_their_field() {
    let (server, flight) = flown().await;
    let (api, path, fine) = (server.api(), flight.path(), flight.scores.clone());
    let mut high = fine.clone();
    high[2] = 1.5;
    let cases = [
        (json!({"score": &fine[..5]}), 422, "score", "5 entries"),
        (json!({"score": high}), 422, "score.2", "0.001 to 0.999"),
        (json!({"score": fine, "steps": [1, 2]}), 422, "steps", "2 entries"),
        (json!({"score": fine, "failed": [0, 0, 2, 0, 0, 0]}), 422, "failed.2", "neither"),
        (json!({"score": fine, "failed": [0, 0, -1, 0, 0, 0]}), 422, "failed.2", "0 or 1"),
        (json!({"score": fine, "steps": [1, 1, 1.5, 1, 1, 1]}), 422, "steps.2", "whole"),
        (json!({"score": [0.1, "x", 0.1, 0.1, 0.1, 0.1]}), 422, "score.1", "a number"),
        (json!({"score": [0.1, null, 0.1, 0.1, 0.1, 0.1]}), 422, "score.1", "a number"),
        (json!({"score": "all fine"}), 422, "score", "list"),
        (json!({"score": 7}), 422, "score", "list"),
        (json!({"score": {}}), 422, "score", "list"),
        (json!({}), 422, "score", "missing"),
        (
            json!({"score": fine, "scores": fine}),
            422,
            "scores",
            "known are policy_version, score, failed, steps",
        ),
        (json!({"score": fine, "policy_version": -1}), 422, "policy_version", "whole"),
        (json!({"score": fine, "policy_version": "1"}), 422, "policy_version", "whole"),
        (json!([fine]), 422, "", ""),
        (json!({"score": vec![0.5; 100_001]}), 422, "score", "100000"),
    ];
    for (body, status, field, words) in cases {
        let answer = api.post(&path, body.clone()).await;
        let (found, at, detail) = told(&answer);
        assert_eq!(found, status, "{body} {answer:?}");
        assert!(at.starts_with(field) && detail.contains(words), "{at}: {detail} (for {field}: {words})");
    }
    for text in ["", "{", "{\"score\": [1,}", "{\"score\": [NaN]}", "{\"score\": [1e999]}", "\u{0}"] {
        let answer = api.raw("POST", &path, "application/json", text.to_owned()).await;
        assert!([400, 422].contains(&answer.status), "{text}: {answer:?}");
    }
    let plain = api.raw("POST", &path, "text/plain", "score").await;
    assert_eq!(plain.status, 415);
}

#[tokio::test]
async fn packed_columns_that_cannot_be_are_told_by_their_field() {
    let (server, flight) = flown().await;
    let (api, path, fine) = (server.api(), flight.path(), flight.scores.clone());
    let single: Vec<f32> = fine.iter().map(|score| *score as f32).collect();
    let mut nan = single.clone();
    nan[4] = f32::NAN;
    let bomb = |count: u32| [&[0xdd], &count.to_be_bytes()[..]].concat();
    let deep = [vec![0x91; 5000], vec![0xc0]].concat();
    let cases = [
        (packed(&[("score", floats(&nan))]), 422, "score.4"),
        (packed(&[("score", bin(&[0; 23]))]), 422, "score"),
        (packed(&[("score", floats(&single[..3]))]), 422, "score"),
        (packed(&[("score", floats(&single)), ("failed", bin(&[0; 5]))]), 422, "failed"),
        (packed(&[("score", bomb(u32::MAX))]), 400, "body"),
        (packed(&[("score", [bomb(2_000_000), vec![0xca; 16]].concat())]), 400, "body"),
        (packed(&[("score", [vec![0xc6], u32::MAX.to_be_bytes().to_vec()].concat())]), 400, "body"),
        (packed(&[("score", deep.clone())]), 400, "body"),
        (deep, 400, "body"),
        ([packed(&[("score", floats(&single))]), vec![0]].concat(), 400, "body"),
        (vec![], 400, "body"),
        (vec![0xc1], 400, "body"),
    ];
    for (at, (body, status, field)) in cases.into_iter().enumerate() {
        let answer = api.raw("POST", &path, "application/msgpack", body).await;
        let (found, named, detail) = told(&answer);
        assert!(found == status || (status == 400 && found == 422), "{at}: {answer:?}");
        assert!(named.starts_with(field) || status == 400, "{at}: {named}: {detail}");
    }
    // Of another run, of a lease of groups, of none.
    let body = json!({"score": fine});
    let foreign = path.replace("/run/", "/other/");
    assert_eq!(
        api.post(&foreign, body.clone()).await.expect(404)["type"],
        "urn:sparring:problem:unknown_lease"
    );
    let groups = api.lease("run", json!({"groups": 2})).await;
    let wrong = format!("/v1/runs/run/leases/{}/columns", groups.id());
    assert_eq!(api.post(&wrong, body.clone()).await.expect(422)["field"], "lease");
    assert_eq!(api.get(&path).await.expect(404)["type"], "urn:sparring:problem:no_columns");
    // Nothing of all this was kept: the same lease takes what is right, packed.
    let steps: Vec<u8> = flight.logs.iter().flat_map(|log| (log.len() as u32).to_le_bytes()).collect();
    let right = packed(&[("score", floats(&single)), ("steps", bin(&steps)), ("failed", bin(&[0; 6]))]);
    let claim = api.raw("POST", &path, "application/msgpack", right).await.expect(200);
    assert_eq!((&claim["state"], &claim["episodes"]), (&json!("claimed"), &json!(6)));
    let _ = api.report("run", flight.due(&claim)).await;
    assert_eq!(flight.standing(&api).await["state"], "accepted");
}

/// Bodies that are begun and never finished hold up nobody.
#[tokio::test]
async fn half_sent_bodies_keep_nobody_waiting() {
    use tokio::io::AsyncWriteExt;
    let (server, flight) = flown().await;
    let (api, path) = (server.api(), flight.path());
    let mut hogs = Vec::new();
    for length in [100, 100, 100, 100, 8_000_000, 8_000_000, 8_000_000, 8_000_000] {
        let address = api.base().trim_start_matches("http://").to_owned();
        let mut hog = tokio::net::TcpStream::connect(&address).await.unwrap();
        let head = format!(
            "POST {path} HTTP/1.1\r\nhost: {address}\r\ncontent-type: application/json\r\ncontent-length: {length}\r\n\r\n{{"
        );
        hog.write_all(head.as_bytes()).await.unwrap();
        hogs.push(hog);
    }
    tokio::time::sleep(std::time::Duration::from_millis(300)).await;
    let claim = api.post(&path, json!({"score": flight.scores}));
    let claim = tokio::time::timeout(std::time::Duration::from_secs(10), claim).await.expect("in time");
    let claim = claim.expect(200);
    let told =
        tokio::time::timeout(std::time::Duration::from_secs(10), api.report("run", flight.due(&claim)));
    let _ = told.await.expect("in time");
    assert_eq!(flight.standing(&api).await["state"], "accepted");
}

#[tokio::test]
async fn leases_of_columns_that_cannot_be() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({})).await;
    let cases = [
        (json!({"groups": 0}), "groups"),
        (json!({"groups": 100_001}), "groups"),
        (json!({"groups": 50_000, "group_size": 3}), "groups × group_size"),
        (json!({"groups": 4_294_967_295u32, "group_size": 1024}), "groups"),
        (json!({"groups": 10, "purpose": "eval"}), "form"),
        (json!({"groups": 10, "ttl_s": 0}), "ttl_s"),
        (json!({"groups": 10, "form": "rows"}), "form"),
    ];
    for (wish, field) in cases {
        let mut asked = json!({"form": "columns"});
        asked.as_object_mut().unwrap().extend(wish.as_object().unwrap().clone());
        let refused: Value = api.post("/v1/runs/run/leases", asked).await.expect(422);
        assert_eq!(refused["field"], field, "{refused}");
    }
    let refused = api.post("/v1/runs", json!({"audit_groups": 0})).await.expect(422);
    assert_eq!(refused["field"], "audit_groups");
    // The largest there is.
    let lease = api.lease("run", json!({"form": "columns", "groups": 100_000})).await;
    assert_eq!(lease.0["ranges"].as_array().unwrap().len(), 64);
    assert!(lease.0.to_string().len() < 100_000, "a lease of 100 000 episodes is small");
}

/// The same request in MessagePack is the same request.
#[tokio::test]
async fn requests_may_be_packed() {
    let server = Server::start().await;
    let api = server.api();
    let wish = packed(&[("id", b"\xa3abc".to_vec()), ("group_size", vec![2])]);
    let run = api.raw("POST", "/v1/runs", "application/msgpack", wish).await.expect(201);
    assert_eq!((&run["id"], &run["settings"]["group_size"]), (&json!("abc"), &json!(2)));
    let twice = packed(&[("id", b"\xa3abd".to_vec()), ("id", b"\xa3abe".to_vec())]);
    let refused = api.raw("POST", "/v1/runs", "application/msgpack", twice).await.expect(422);
    assert_eq!(refused["field"], "id");
    for bytes in [
        vec![0xc1],
        vec![0x81, 0x01, 0x02],
        packed(&[("id", vec![0xc4, 1, 0])]),
        vec![0xdf, 255, 255, 255, 255],
    ] {
        let refused = api.raw("POST", "/v1/runs", "application/msgpack", bytes).await;
        assert!([400, 422].contains(&refused.status), "{refused:?}");
    }
    // One byte a value: more of them than can be held.
    let many = [vec![0xdd, 0, 0x60, 0, 0], vec![0xc0; 0x60_0000]].concat();
    let refused = api.raw("POST", "/v1/runs/abc/results", "application/msgpack", many).await;
    assert!([400, 413].contains(&refused.status), "{refused:?}");
}
