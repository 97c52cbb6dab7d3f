//! The reference trainers of `examples/`, in Python, against a real server.

use std::path::Path;
use std::process::Command;

use system_tests::Server;

#[expect(clippy::print_stderr, reason = "who reads the tests' output should know what was not run")]
async fn run(script: &'static str, args: &'static [&'static str]) -> Option<String> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let python = root.join("target/openenv-venv/bin/python");
    if !python.exists() {
        assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
        eprintln!("skipped: `make test` installs websockets first");
        return None;
    }
    let mut server = Server::start().await;
    let url = server.api().base().to_owned();
    let run = move || {
        Command::new(python).arg(root.join("examples").join(script)).arg(url).args(args).output().unwrap()
    };
    let out = tokio::task::spawn_blocking(run).await.unwrap();
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
