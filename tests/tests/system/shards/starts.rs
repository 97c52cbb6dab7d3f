//! `sparring serve --shard --peers`: errors of the start, and what a database remembers.

use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::json;
use system_tests::{ServerProcess, sparring_binary};

use super::{create, ids};

/// Runs a start that must fail with exit code 2, and returns its message in one line.
fn failure(db: &Path, options: &[&str]) -> String {
    let mut command = Command::new(sparring_binary());
    command
        .args(["serve", "--port", "0", "--log", "error", "--db"])
        .arg(db)
        .args(options)
        .stdin(Stdio::null());
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{options:?}: {output:?}");
    String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ")
}

#[tokio::test(flavor = "multi_thread")]
async fn invalid_shards_and_peers_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    for (options, words) in [
        (&["--shard", "East"][..], "1 to 16 characters of a-z and 0-9, got \"East\""),
        (&["--shard", "east", "--peers", "west"], "has no URL"),
        (&["--shard", "east", "--peers", "west=10.0.0.6:8700"], "is not the URL of a server"),
        (&["--shard", "east", "--peers", "We=http://a"], "got \"We\""),
        (&["--shard", "east", "--peers", "east=http://a"], "which is the shard of this server"),
        (&["--shard", "east", "--peers", "a=http://a,a=http://b"], "lists the shard a twice"),
        (
            &["--shard", "east", "--peers", "a=http://a", "--peers", "b=http://a/"],
            "lists the URL http://a twice",
        ),
        (&["--peers", "west=http://a"], "add --shard NAME"),
    ] {
        let message = failure(&db, options);
        assert!(message.contains(words), "{options:?}: {message}");
    }
    // None of these starts gave the database a shard.
    let server = ServerProcess::start_with_options(&db, &["--shard", "north"]);
    assert!(create(&server.api(), json!({})).await.starts_with("north.run-"));
    server.kill();
    let message = failure(&db, &["--shard", "east"]);
    assert!(message.contains("belongs to the shard north") && message.contains("--shard north"), "{message}");
}

#[tokio::test(flavor = "multi_thread")]
async fn database_remembers_its_shard_and_keeps_earlier_ids() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let server = ServerProcess::start(&db);
    let api = server.api();
    assert_eq!(create(&api, json!({"id": "old"})).await, "old");
    let refused = api.post("/v1/runs", json!({"id": "east.new"})).await.expect(422);
    assert!(refused["detail"].as_str().unwrap().contains("this server has no shard"), "{refused}");
    server.kill();

    let server = ServerProcess::start_with_options(&db, &["--shard", "east"]);
    create(&server.api(), json!({"id": "east.new"})).await;
    server.kill();

    let server = ServerProcess::start(&db);
    let api = server.api();
    let third = create(&api, json!({})).await;
    assert!(third.starts_with("east.run-"), "{third}");
    let page = api.get("/v1/runs").await.expect(200);
    assert_eq!(ids(&page), ["old".to_owned(), "east.new".to_owned(), third]);
    for run in ids(&page) {
        let _ = api.get(&format!("/v1/runs/{run}/mastery")).await.expect(200);
    }
    server.kill();

    // Commands without a server read the database too.
    let output = Command::new(sparring_binary())
        .args(["runs", "show", "east.new", "--json", "--db"])
        .arg(&db)
        .output();
    let output = output.unwrap();
    assert!(output.status.success(), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("east.new"), "{output:?}");
}
