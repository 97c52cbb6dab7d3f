//! The example trainer, as `docs/trajectories.md` shows it.

use std::path::Path;
use std::process::Command;

use serde_json::Value;
use system_tests::Server;

use super::{number, policy};

#[tokio::test]
async fn the_example_trains_in_both_forms() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let python = root.join("target/openenv-venv/bin/python");
    if !python.exists() {
        assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
        eprintln!("skipped: `make test` installs msgpack first");
        return;
    }
    let server = Server::start().await;
    for form in ["json", "msgpack"] {
        let mut command = Command::new(&python);
        command.arg(root.join("examples/trajectories.py")).args(["--url", server.api().base()]);
        command.args(["--groups", "12", "--form", form, "--run", form]);
        let out = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
        let said = String::from_utf8_lossy(&out.stdout).into_owned();
        assert!(out.status.success(), "{said}{}", String::from_utf8_lossy(&out.stderr));
        let last: Vec<&str> = said.lines().last().unwrap().split(' ').collect();
        assert_eq!(last[..2], ["12", "groups,"], "{said}");
        let told: Value = policy(&server.api(), form).await;
        assert!(number(&told["groups"]) >= 12 && number(&told["feed"]["acked"]) >= 12, "{told}");
        assert_eq!(told["policy"], "off");
    }
}
