//! The example trainer of `docs/reference/trajectories.md`.

use std::path::Path;
use std::process::Command;

use serde_json::Value;
use system_tests::Server;

use super::{number, policy};

#[tokio::test]
async fn example_trains_in_json_and_msgpack() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let python = root.join("target/openenv-venv/bin/python");
    if !python.exists() {
        assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
        eprintln!("skipped: `make test` installs msgpack first");
        return;
    }
    let server = Server::start().await;
    for format in ["json", "msgpack"] {
        let mut command = Command::new(&python);
        command.arg(root.join("examples/trajectories.py")).args(["--url", server.api().base()]);
        command.args(["--groups", "12", "--form", format, "--run", format]);
        let output = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
        let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{stdout}{}", String::from_utf8_lossy(&output.stderr));
        let last: Vec<&str> = stdout.lines().last().unwrap().split(' ').collect();
        assert_eq!(last[..2], ["12", "groups,"], "{stdout}");
        let policy_state: Value = policy(&server.api(), format).await;
        assert!(
            number(&policy_state["groups"]) >= 12 && number(&policy_state["feed"]["acknowledged"]) >= 12,
            "{policy_state}"
        );
        assert_eq!(policy_state["policy"], "off");
    }
}
