//! The reference trainers of `examples/`, in Python, against a real server.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Stdio};

use system_tests::{Process, Server};

/// Python with websockets, about to run an example.
#[expect(clippy::print_stderr, reason = "who reads the tests' output should know what was not run")]
fn example(script: &str) -> Option<Command> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let python = root.join("target/openenv-venv/bin/python");
    if !python.exists() {
        assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
        eprintln!("skipped: `make test` installs websockets first");
        return None;
    }
    let mut command = Command::new(python);
    command.arg(root.join("examples").join(script));
    Some(command)
}

async fn run(script: &str, args: &'static [&'static str]) -> Option<String> {
    let mut command = example(script)?;
    let mut server = Server::start().await;
    command.arg(server.api().base()).args(args);
    let out = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(out.status.success(), "{said}{}", String::from_utf8_lossy(&out.stderr));
    server.stop().await;
    Some(said)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainer_steps_one_environment() {
    let Some(said) = run("step.py", &["4"]).await else { return };
    assert_eq!(said.lines().filter(|line| line.contains(" counted score ")).count(), 4, "{said}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainer_steps_many() {
    let Some(said) = run("vector.py", &["2"]).await else { return };
    assert_eq!(said.lines().filter(|line| line.ends_with("32 flown, 32 counted")).count(), 2, "{said}");
}

/// A server that is killed and started anew costs the trainer what it was just flying, and no result.
#[tokio::test(flavor = "multi_thread")]
async fn a_trainer_outlasts_its_server() {
    const EPISODES: usize = 60;
    let Some(mut command) = example("step.py") else { return };
    // A port that was free a moment ago.
    let bind = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("s.db");
    let mut server = Process::start_at(&bind, &db, &[]);
    command.arg(format!("http://{bind}")).arg(EPISODES.to_string()).stdout(Stdio::piped());
    let mut trainer = command.spawn().unwrap();
    let mut lines = BufReader::new(trainer.stdout.take().unwrap()).lines();
    let mut told = BTreeSet::new();
    for before_the_end in [3, 4, 5, EPISODES] {
        for line in lines.by_ref().take(before_the_end) {
            let line = line.unwrap();
            let [episode, status, ..] = line.split(' ').collect::<Vec<_>>()[..] else { panic!("{line}") };
            // Of a designed layout it is stored: that moves no level.
            assert!(["counted", "stored"].contains(&status), "{line}");
            assert!(told.insert(episode.to_owned()), "{episode} twice");
        }
        if before_the_end < EPISODES {
            server.kill();
            assert!(trainer.try_wait().unwrap().is_none(), "it is not yet done");
            server = Process::start_at(&bind, &db, &[]);
        }
    }
    assert!(trainer.wait().unwrap().success());
    assert_eq!(told.len(), EPISODES);
    let api = server.api();
    let runs = api.get("/v1/runs").await.expect(200);
    let id = runs["runs"][0]["id"].as_str().unwrap();
    for episode in told {
        let kept = api.get(&format!("/v1/runs/{id}/episodes/{episode}")).await.expect(200);
        assert_eq!(kept["state"], "finished", "{kept}");
    }
    server.kill();
}
