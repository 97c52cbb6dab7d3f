//! openenv-core's own clients, from the package index, against a real server.

use std::path::Path;
use std::process::Command;

use system_tests::Server;

#[tokio::test]
async fn openenv_cores_clients_fly_unchanged() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let python = root.join("target/openenv-venv/bin/python");
    if !python.exists() {
        assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
        eprintln!("skipped: `make test` installs openenv-core first");
        return;
    }
    let mut server = Server::start().await;
    let url = server.api().base().to_owned();
    let script = root.join("tests/clients/openenv_clients.py");
    let run = move || Command::new(python).arg(script).arg(url).output().unwrap();
    let out = tokio::task::spawn_blocking(run).await.unwrap();
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(out.status.success(), "{said}{}", String::from_utf8_lossy(&out.stderr));
    assert_eq!(said.lines().count(), 4, "{said}");
    server.stop().await;
}
