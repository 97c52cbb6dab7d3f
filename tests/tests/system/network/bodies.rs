//! Bodies in unusual forms: compressed, with a byte order mark, and with numbers that are not finite.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::{Value, json};
use system_tests::{ApiClient, IncompletePost, ServerProcess, http_client};

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Posts an encoded JSON body, and returns the status with the body of the response.
async fn post(api: &ApiClient, path: &str, encoding: &str, body: Vec<u8>) -> (u16, String) {
    let request = http_client().post(format!("{}{path}", api.base()));
    let request = request.header("content-type", "application/json").header("content-encoding", encoding);
    let response = request.body(body).send().await.unwrap();
    (response.status().as_u16(), response.text().await.unwrap())
}

#[tokio::test]
async fn gzip_bodies_are_read_within_the_limits() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let api = server.api();
    let created = post(&api, "/v1/runs", "gzip", gzip(br#"{"id": "run"}"#)).await;
    assert_eq!(created.0, 201, "{}", created.1);
    let reset = post(&api, "/reset", "gzip", gzip(br#"{"seed": 1}"#)).await;
    assert_eq!(reset.0, 200, "{}", reset.1);
    let results = "/v1/runs/run/results";
    let empty = post(&api, results, "gzip", gzip(br#"{"results": []}"#)).await;
    assert_eq!(empty.0, 200, "{}", empty.1);
    // A body that is small in the network and large in memory.
    let bomb = gzip(&vec![b' '; 64 << 20]);
    assert!(bomb.len() < 1 << 20);
    for (path, limit) in
        [("/v1/runs", "at most 1 MiB"), (results, "at most 16 MiB"), ("/reset", "at most 1 MiB")]
    {
        let (status, text) = post(&api, path, "gzip", bomb.clone()).await;
        assert_eq!(status, 413, "{path}: {text}");
        assert!(text.contains(limit), "{path}: {text}");
    }
    // Several members are one body; the encoding is not case-sensitive and has an old name.
    for (encoding, id) in [("GZIP", "upper"), ("x-gzip", "old")] {
        let members = [gzip(br#"{"id": "#), gzip(b""), gzip(format!("\"{id}\"}}").as_bytes())].concat();
        let (status, text) = post(&api, "/v1/runs", encoding, members).await;
        assert_eq!(status, 201, "{encoding}: {text}");
    }
    let whole = gzip(br#"{"id": "other"}"#);
    let cut = whole[..whole.len() - 9].to_vec();
    let trailing = [&whole[..], b"{}"].concat();
    let cut_member = [&whole[..], &gzip(b" ")[..12]].concat();
    // Members without content cost time, and have no end.
    let empty_members = gzip(b"").repeat(100_000);
    for broken in [cut, trailing, cut_member, empty_members, b"{}".to_vec()] {
        let (status, text) = post(&api, "/v1/runs", "gzip", broken).await;
        assert_eq!(status, 400, "{text}");
        assert!(text.contains("could not be read to its end"), "{text}");
    }
    for path in ["/v1/runs", "/reset", "/mcp"] {
        let (status, text) = post(&api, path, "br", b"{}".to_vec()).await;
        assert_eq!(status, 415, "{path}: {text}");
        assert!(
            text.contains("The body has the encoding br; send it as gzip or without an encoding."),
            "{text}"
        );
    }
}

/// The server checks a declared length before it reads the body.
#[tokio::test]
async fn declared_length_is_checked_against_the_limit_of_the_route() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    for (path, length, limit) in [
        ("/v1/runs", (1 << 20) + 1, "at most 1 MiB"),
        ("/v1/runs/run/results", (16 << 20) + 1, "at most 16 MiB"),
        ("/reset", (1 << 20) + 1, "at most 1 MiB"),
    ] {
        let response = IncompletePost::send_head(&api, path, length).await.response().await;
        assert!(response.starts_with("HTTP/1.1 413 ") && response.contains(limit), "{path}: {response}");
    }
}

#[tokio::test]
async fn byte_order_mark_is_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let api = server.api();
    let json = "application/json";
    let _ = api.request("POST", "/v1/runs", json, "\u{feff}{\"id\": \"run\"}").await.expect(201);
    let _ = api.request("POST", "/v1/runs/run/results", json, "\u{feff}{\"results\": []}").await.expect(200);
    let _ = api.request("POST", "/reset", json, "\u{feff}{\"seed\": 1}").await.expect(200);
    let list = "\u{feff}{\"jsonrpc\": \"2.0\", \"id\": 1, \"method\": \"tools/list\"}";
    assert!(api.request("POST", "/mcp", json, list).await.expect(200)["result"].is_object());
}

/// Number in place of which a test writes one that is not finite: `serde_json` has no such number.
const PLACEHOLDER: f64 = 1.25e77;

/// Body with a number that is not finite in place of [`PLACEHOLDER`], in its format.
struct NonFiniteBody {
    content_type: &'static str,
    /// The number as errors show it.
    number: &'static str,
    bytes: Vec<u8>,
}

/// Encodes a body as MessagePack and as JSON of Python.
fn non_finite_bodies(body: &Value) -> [NonFiniteBody; 3] {
    let mut packed = rmp_serde::to_vec(body).unwrap();
    let at = packed.windows(8).position(|window| window == PLACEHOLDER.to_be_bytes()).unwrap();
    packed[at..at + 8].copy_from_slice(&f64::NAN.to_be_bytes());
    let json = |number: &'static str| NonFiniteBody {
        content_type: "application/json",
        number,
        bytes: body.to_string().replace(&json!(PLACEHOLDER).to_string(), number).into_bytes(),
    };
    let packed = NonFiniteBody { content_type: "application/msgpack", number: "NaN", bytes: packed };
    [packed, json("NaN"), json("1e999")]
}

#[tokio::test]
async fn number_that_is_not_finite_refuses_one_result_by_field() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let api = server.api();
    let run = json!({"id": "run", "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", run).await.expect(201);
    let path = "/v1/runs/run/results";
    let mut results = api.lease("run", json!({"groups": 3})).await.results("hold");
    results[1]["actions"]["steps"][0] = json!([[0, PLACEHOLDER, 0.0]]);
    let mut status = "counted";
    for NonFiniteBody { content_type, number, bytes } in non_finite_bodies(&json!({"results": results})) {
        let report = api.request("POST", path, content_type, bytes).await.expect(200);
        let statuses: Vec<&Value> =
            report["results"].as_array().unwrap().iter().map(|r| &r["status"]).collect();
        assert_eq!(statuses, [status, "refused", status], "{report}");
        let refused = report["results"][1].to_string();
        let expected = format!("actions.steps.0.0.1: must be a finite number, got {number}");
        assert!(refused.contains(&expected), "{refused}");
        status = "duplicate";
    }
    // A number outside the results has no item that could be refused.
    let policy_version = non_finite_bodies(&json!({"results": [], "policy_version": PLACEHOLDER}));
    let contested_share = non_finite_bodies(&json!({"contested_share": PLACEHOLDER}));
    for (path, field, bodies) in
        [(path, "policy_version", policy_version), ("/v1/runs", "contested_share", contested_share)]
    {
        for NonFiniteBody { content_type, number, bytes } in bodies {
            let problem = api.request("POST", path, content_type, bytes).await.expect(422);
            assert_eq!(problem["detail"], format!("must be a finite number, got {number}"));
            assert_eq!(problem["field"], field, "{problem}");
        }
    }
}
