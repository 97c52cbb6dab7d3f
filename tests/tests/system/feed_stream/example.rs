//! The example trainer that reads the feed by nats-py alone.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use super::*;

/// Runs the example in Python, in a thread.
fn run_example(python: PathBuf, arguments: Vec<String>) -> tokio::task::JoinHandle<Output> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    tokio::task::spawn_blocking(move || {
        Command::new(python).arg(root.join("examples/feed_nats.py")).args(arguments).output().unwrap()
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn example_trains_alone_and_beside_another() {
    let python = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("target/openenv-venv/bin/python");
    if !python.exists() {
        assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
        eprintln!("skipped: `make test` installs nats-py first");
        return;
    }
    let Some(nats) = NatsServer::start() else { return };
    let cluster = WorkerCluster::start(Some(nats), 0).await;
    let (url, nats) = (cluster.server().url().to_owned(), cluster.nats.as_ref().unwrap().url());
    let arguments = |consumer: &str| {
        ["--url", &url, "--nats", &nats, "--run", "run", "--groups", "12", "--consumer", consumer]
            .map(str::to_owned)
            .to_vec()
    };
    let first = run_example(python.clone(), arguments("first"));
    wait_for("the run exists", async || {
        let run = cluster.api().get("/v1/runs/run/policy").await;
        (run.status == 200 && run.expect(200)["delivery"] == "nats").then_some(())
    })
    .await;
    let second = run_example(python, arguments("second"));
    for example in [first, second] {
        let output = example.await.unwrap();
        let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{stdout}{}", String::from_utf8_lossy(&output.stderr));
        assert!(stdout.lines().last().unwrap().starts_with("12 groups,"), "{stdout}");
    }
    system_tests::wait_until("the server has read the acknowledgements", async || {
        policy(&cluster.api(), "run").await["feed"]["acknowledged"].as_i64() >= Some(12)
    })
    .await;
}
