//! The Python reference trainers of `examples/` against a real server.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use system_tests::{Server, ServerProcess};

/// Builds the command of an example; returns `None` if the Python environment is not installed.
#[expect(clippy::print_stderr, reason = "the test output shows what was skipped")]
fn example_command(script: &str) -> Option<Command> {
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

async fn run_example(script: &str, args: &'static [&'static str]) -> Option<String> {
    let mut command = example_command(script)?;
    let mut server = Server::start().await;
    command.arg(server.api().base()).args(args);
    let output = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
    let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{stdout}{}", String::from_utf8_lossy(&output.stderr));
    server.stop().await;
    Some(stdout)
}

#[tokio::test(flavor = "multi_thread")]
async fn step_example_reports_its_episodes() {
    let Some(stdout) = run_example("step.py", &["4"]).await else { return };
    assert_eq!(stdout.lines().filter(|line| line.contains(" counted score ")).count(), 4, "{stdout}");
}

#[tokio::test(flavor = "multi_thread")]
async fn vector_example_reports_its_episodes() {
    let Some(stdout) = run_example("vector.py", &["2"]).await else { return };
    assert_eq!(
        stdout.lines().filter(|line| line.ends_with("32 finished, 32 counted")).count(),
        2,
        "{stdout}"
    );
}

/// A killed and restarted server costs the trainer its current episode, but no result.
#[tokio::test(flavor = "multi_thread")]
async fn step_example_survives_server_kills() {
    const EPISODES: usize = 60;
    let Some(mut command) = example_command("step.py") else { return };
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("s.db");
    let mut server = ServerProcess::start(&db);
    let bind = server.address().to_owned();
    command.arg(format!("http://{bind}")).arg(EPISODES.to_string()).stdout(Stdio::piped());
    let mut trainer = command.spawn().unwrap();
    let mut lines = BufReader::new(trainer.stdout.take().unwrap()).lines();
    let mut reported = BTreeSet::new();
    for episodes_before_kill in [3, 4, 5, EPISODES] {
        for line in lines.by_ref().take(episodes_before_kill) {
            let line = line.unwrap();
            let [episode, status, ..] = line.split(' ').collect::<Vec<_>>()[..] else { panic!("{line}") };
            // Results of designed layouts are stored without counting for mastery.
            assert!(["counted", "stored"].contains(&status), "{line}");
            assert!(reported.insert(episode.to_owned()), "{episode} twice");
        }
        if episodes_before_kill < EPISODES {
            server.kill();
            assert!(trainer.try_wait().unwrap().is_none(), "the trainer is still running");
            server = ServerProcess::start_at(&bind, &db, &[]);
        }
    }
    assert!(trainer.wait().unwrap().success());
    assert_eq!(reported.len(), EPISODES);
    let api = server.api();
    let runs = api.get("/v1/runs").await.expect(200);
    let id = runs["runs"][0]["id"].as_str().unwrap();
    for episode in reported {
        let stored = api.get(&format!("/v1/runs/{id}/episodes/{episode}")).await.expect(200);
        assert_eq!(stored["state"], "finished", "{stored}");
    }
    server.kill();
}
