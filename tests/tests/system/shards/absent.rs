//! One of two servers is away, hangs, or is another server than the peers expect.

use std::time::{Duration, Instant};

use serde_json::{Value, json};
use system_tests::nginx::free_address;
use system_tests::shard_cluster::ShardCluster;
use system_tests::{ServerProcess, wait_until};

use super::{create, ids, train};

/// Longest time of a list while a peer is away: two seconds, and a margin for a busy machine.
const LIST_TIME: Duration = Duration::from_secs(8);

#[tokio::test(flavor = "multi_thread")]
async fn list_answers_while_a_shard_is_away() {
    let mut cluster = ShardCluster::start().await;
    let api = cluster.api();
    for run in ["east.kept", "west.away"] {
        create(&api, json!({"id": run})).await;
        train(&api, run, 4).await;
    }
    let lease = api.lease("west.away", json!({"groups": 2})).await;
    cluster.west.kill();
    let asked = Instant::now();
    let page = api.get("/v1/runs").await.expect(200);
    assert!(asked.elapsed() < LIST_TIME, "{:?}", asked.elapsed());
    assert_eq!((ids(&page), &page["total"]), (vec!["east.kept".to_owned()], &json!(1)));
    assert_eq!(page["missing_shards"], json!([{"shard": "west", "reason": "the server cannot be reached"}]));
    for path in ["/v1/run_groups?by=tag", "/v1/evaluations", "/v1/alerts"] {
        assert_eq!(api.get(path).await.expect(200)["missing_shards"][0]["shard"], "west", "{path}");
    }
    let absent = api.get("/v1/runs/west.away").await;
    assert!([502, 503].contains(&absent.status), "{absent:?}");
    let refused = api.post("/v1/runs", json!({"id": "west.new"})).await.expect(503);
    assert_eq!(refused["type"], "urn:sparring:problem:shard_unavailable");
    assert!(refused["detail"].as_str().unwrap().contains("The shard west"), "{refused}");
    // The other shard goes on, and takes all new runs.
    train(&api, "east.kept", 4).await;
    for _ in 0..2 {
        assert!(create(&api, json!({})).await.starts_with("east."));
    }

    cluster.west.start();
    wait_until("the run is back", async || api.get("/v1/runs/west.away").await.status == 200).await;
    assert_eq!(api.get("/v1/runs/west.away").await.expect(200)["episodes"], 4);
    let answer = api.report("west.away", lease.results("hold")).await;
    assert!(
        answer["results"].as_array().unwrap().iter().all(|result| result["status"] == "counted"),
        "{answer}"
    );
    let page = api.get("/v1/runs").await.expect(200);
    assert_eq!((&page["total"], &page["missing_shards"]), (&json!(4), &json!([])));
}

#[tokio::test(flavor = "multi_thread")]
async fn list_answers_while_the_first_server_is_away() {
    let mut cluster = ShardCluster::start().await;
    let api = cluster.api();
    create(&api, json!({"id": "east.away"})).await;
    create(&api, json!({"id": "west.kept"})).await;
    cluster.east.kill();
    let page = api.get("/v1/runs").await.expect(200);
    assert_eq!(
        (ids(&page), &page["missing_shards"][0]["shard"]),
        (vec!["west.kept".to_owned()], &json!("east"))
    );
    assert_eq!(api.get("/v1/health").await.expect(200)["shard"], "west");
    assert!(create(&api, json!({})).await.starts_with("west."));
    train(&api, "west.kept", 2).await;
}

/// Starts a server of the shard `east` with one peer, and returns why the part of the peer is missing.
async fn missing_reason(peer: &str) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let peers = format!("west=http://{peer}");
    let options = ["--shard", "east", "--peers", &peers];
    let server = ServerProcess::start_with_options(&folder.path().join("db.sqlite3"), &options);
    let asked = Instant::now();
    let page = server.api().get("/v1/runs").await.expect(200);
    assert!(asked.elapsed() < LIST_TIME, "{:?}", asked.elapsed());
    assert_eq!(page["missing_shards"][0]["shard"], "west");
    page["missing_shards"][0]["reason"].clone()
}

#[tokio::test(flavor = "multi_thread")]
async fn peer_that_hangs_or_is_another_server_is_missing() {
    let silent = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = silent.local_addr().unwrap().to_string();
    assert_eq!(missing_reason(&address).await, "the server did not answer within 2 s");
    assert_eq!(missing_reason(&free_address()).await, "the server cannot be reached");
    let folder = tempfile::tempdir().unwrap();
    let plain = ServerProcess::start(&folder.path().join("plain.sqlite3"));
    let reason = missing_reason(plain.address()).await;
    assert!(reason.as_str().unwrap().contains("has no shard"), "{reason}");
    let other =
        ServerProcess::start_with_options(&folder.path().join("north.sqlite3"), &["--shard", "north"]);
    let reason = missing_reason(other.address()).await;
    assert!(reason.as_str().unwrap().contains("has the shard north"), "{reason}");
}
