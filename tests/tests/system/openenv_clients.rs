//! Clients of OpenEnv and of the Model Context Protocol, from the package index, against a real server.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::json;
use system_tests::mock_llm::{HOLD_ACTION, chat_response, start_endpoint};
use system_tests::{ApiClient, http_client, sparring_binary};

use crate::trajectories::chat_policy::{model_config, start_server};

/// Runs a script of `tests/clients` with a virtual environment of `target/` against a server, and returns its lines. `None` if
/// the environment is not installed.
#[expect(clippy::print_stderr, reason = "a test that is skipped says so")]
async fn run_clients(venv: &str, script: &str) -> Option<String> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let python = root.join("target").join(venv).join("bin/python");
    if !python.exists() {
        assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
        eprintln!("skipped: `SPARRING_TRAINERS=1 scripts/openenv-venv` installs target/{venv}");
        return None;
    }
    let llm = start_endpoint([chat_response(HOLD_ACTION)]).await;
    let mut server = start_server(model_config(&llm.uri())).await;
    let url = server.api().base().to_owned();
    let script = root.join("tests/clients").join(script);
    let run = move || Command::new(python).arg(script).arg(url).arg(sparring_binary()).output().unwrap();
    let out = tokio::task::spawn_blocking(run).await.unwrap();
    let stdout = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(out.status.success(), "{stdout}{}", String::from_utf8_lossy(&out.stderr));
    server.stop().await;
    Some(stdout)
}

#[tokio::test]
async fn openenv_core_clients_run_unmodified() {
    if let Some(lines) = run_clients("openenv-venv", "openenv_clients.py").await {
        assert_eq!(lines.lines().count(), 6, "{lines}");
    }
}

#[tokio::test]
async fn openenv_0_10_runs_what_openenv_core_runs() {
    if let Some(lines) = run_clients("openenv-0.10-venv", "openenv_clients.py").await {
        assert_eq!(lines.lines().count(), 6, "{lines}");
    }
}

#[tokio::test]
async fn openenv_0_10_clients_run_unmodified() {
    if let Some(lines) = run_clients("openenv-0.10-venv", "openenv_0_10_clients.py").await {
        assert_eq!(lines.lines().count(), 5, "{lines}");
    }
}

#[tokio::test]
async fn client_of_the_mcp_sdk_flies_episodes() {
    if let Some(lines) = run_clients("mcp-venv", "mcp_clients.py").await {
        assert_eq!(lines.lines().count(), 3, "{lines}");
    }
}

/// Runs the command of the Dockerfile on a free port: OpenEnv is public, the API of runs is absent.
#[tokio::test]
async fn container_command_serves_openenv_only() {
    let dockerfile = include_str!("../../../Dockerfile");
    let command = dockerfile.lines().find_map(|line| line.strip_prefix("CMD ")).expect("a command");
    let command: Vec<String> = serde_json::from_str(command).expect("its words");
    assert_eq!((command[0].as_str(), command.last().expect("words").as_str()), ("sparring", "0.0.0.0:8000"));
    assert!(include_str!("../../../openenv.yaml").contains("port: 8000"));
    let folder = tempfile::tempdir().expect("a folder");
    let mut server = Command::new(sparring_binary())
        .args(&command[1..command.len() - 1])
        .arg("0.0.0.0:0")
        .current_dir(folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("the server starts");
    let mut line = String::new();
    BufReader::new(server.stdout.take().expect("its output")).read_line(&mut line).expect("its first line");
    let port = line.trim().rsplit(':').next().expect("a port").to_owned();
    let api = ApiClient::new(&format!("http://127.0.0.1:{port}"));
    assert_eq!(api.get("/health").await.expect(200), json!({"status": "healthy"}));
    for path in ["/v1/runs", "/v1/tasks", "/v1/layouts"] {
        assert_eq!(api.get(path).await.status, 404, "{path}");
    }
    let document = api.get("/openapi.json").await.expect(200).to_string();
    assert!(
        document.contains("\"/reset\"") && !document.contains("/v1/"),
        "the document omits operations that are not served"
    );
    let reset = api.post("/reset", json!({"task": "survival", "seed": 1})).await.expect(200);
    assert_eq!(reset["done"], false);
    assert_eq!(api.post("/step", json!({"burns": []})).await.expect(200)["done"], false);
    // The web page works without the operations that are absent.
    let page = http_client().get(format!("{}/web/", api.base())).send().await.expect("a page");
    let page = page.text().await.expect("text");
    assert!(page.contains(">docking/single</option>") && !page.contains("/v1/"), "{page}");
    let refused = api.post("/reset", json!({"run": "any"})).await;
    assert!((400..500).contains(&refused.status), "{refused:?}");
    server.kill().expect("the server runs");
    let _ = server.wait();
    // Without --openenv-public the server refuses a public address.
    let output = Command::new(sparring_binary())
        .args(["serve", "--bind", "0.0.0.0:0"])
        .current_dir(folder.path())
        .output();
    let output = output.expect("it exits");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--openenv-public"));
}
