//! Clients with one token for all shards.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::json;
use system_tests::shard_cluster::ShardCluster;
use system_tests::{sparring_binary, wait_until};

use super::{create, ids, train};

/// Creates a token, or stores the one that standard input has.
fn create_token(db: &Path, name: &str, stdin: Option<&str>) -> Output {
    let mut command = Command::new(sparring_binary());
    command.args(["token", "create", name, "--role", "trainer", "--db"]).arg(db);
    command
        .args(stdin.map(|_| "--stdin"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut process = command.spawn().unwrap();
    write!(process.stdin.take().unwrap(), "{}", stdin.unwrap_or_default()).unwrap();
    process.wait_with_output().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn one_token_is_valid_on_all_shards() {
    let cluster = ShardCluster::start().await;
    let created = create_token(cluster.east.db(), "ppo", None);
    assert!(created.status.success(), "{created:?}");
    let token = String::from_utf8(created.stdout).unwrap().trim().to_owned();
    let other = String::from_utf8(create_token(cluster.west.db(), "other", None).stdout).unwrap();
    let refused = create_token(cluster.west.db(), "ppo", Some(&token));
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && message.contains("create tokens on one server only"), "{message}");
    let refused = create_token(cluster.west.db(), "ppo", Some("nothing"));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("no token"), "{refused:?}");

    let api = cluster.api().with_token(&token);
    wait_until("the token is required", async || cluster.west.api().get("/v1/runs").await.status == 401)
        .await;
    wait_until("the token is known", async || api.get("/v1/runs").await.status == 200).await;
    let missing = api.get("/v1/runs").await.expect(200)["missing_shards"][0]["reason"].clone();
    assert!(missing.as_str().unwrap().contains("rejects the token"), "{missing}");
    drop(other);

    // The second token of the first server has a number that is free on the second server.
    let second = String::from_utf8(create_token(cluster.east.db(), "ppo-2", None).stdout).unwrap();
    let stored = create_token(cluster.west.db(), "ppo-2", Some(&second));
    assert!(stored.status.success() && stored.stdout.is_empty(), "{stored:?}");
    let api = cluster.api().with_token(second.trim());
    wait_until("both servers know the token", async || {
        let page = api.get("/v1/runs").await;
        page.status == 200 && page.body["missing_shards"] == json!([])
    })
    .await;
    for run in ["east.mine", "west.mine"] {
        create(&api, json!({"id": run})).await;
        train(&api, run, 1).await;
        assert_eq!(api.get(&format!("/v1/runs/{run}")).await.expect(200)["owner"], "ppo-2");
    }
    assert_eq!(ids(&api.get("/v1/runs").await.expect(200)), ["east.mine", "west.mine"]);
    let _ = cluster.api().get("/v1/runs").await.expect(401);
}
