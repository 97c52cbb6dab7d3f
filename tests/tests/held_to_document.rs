//! schemathesis, from the package index, asks a running server what its OpenAPI document says may be asked, and what may not: no
//! answer that is not documented, and none that is a failure.

use std::path::Path;
use std::process::Command;

use serde_json::json;
use system_tests::{Process, binary, result};

/// Cases that are made up for each operation, beside those that cover its bounds; SPARRING_SCHEMATHESIS for more by hand.
const EXAMPLES: &str = "6";

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_answered_that_is_not_documented() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let python = root.join("target/openenv-venv/bin/python");
    if !python.exists() {
        assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
        eprintln!("skipped: `make test` installs schemathesis first");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let token =
        Command::new(binary()).args(["token", "create", "all", "--role", "admin", "--db"]).arg(&db).output();
    let token = String::from_utf8(token.unwrap().stdout).unwrap().trim().to_owned();
    // It asks as fast as it can.
    let server = Process::start_with(&db, &["--requests-each", "1000000", "--requests-anonymous", "1000000"]);
    let api = server.api().with_token(&token);
    let _ = api.post("/v1/runs", json!({"id": "run", "group_size": 2})).await.expect(201);
    let lease = api.lease("run", json!({"groups": 4, "ttl_s": 3600})).await;
    let flown: Vec<_> = lease.episodes().iter().take(3).map(|(id, s)| result(id, s, "hold")).collect();
    let _ = api.report("run", flown).await;
    let policy = json!({"policy": "random", "version": 1}).to_string();
    let _ = api.raw("PUT", "/v1/runs/run/policy", "application/json", policy).await.expect(200);

    let clients = root.join("tests/clients");
    let config = std::fs::read_to_string(clients.join("schemathesis.toml")).unwrap();
    let config = config.replace("LEASE", lease.id()).replace("EPISODE", &lease.episodes()[0].0);
    let path = folder.path().join("schemathesis.toml");
    std::fs::write(&path, config).unwrap();
    let examples = std::env::var("SPARRING_SCHEMATHESIS").unwrap_or_else(|_| EXAMPLES.to_owned());
    let mut command = Command::new(python);
    command
        .args(["-m", "schemathesis.cli", "--config-file"])
        .arg(path)
        .args(["run", &format!("{}/openapi.json", api.base())])
        .args(["--phases", "coverage,fuzzing", "--seed", "1", "--workers", "2"])
        .args(["--max-examples", &examples, "--request-timeout", "60", "--continue-on-failure", "--no-color"])
        .args(["--header", &format!("Authorization: Bearer {token}")])
        .env("SCHEMATHESIS_HOOKS", "schemathesis_hooks")
        .env("PYTHONPATH", &clients)
        .current_dir(folder.path());
    let out = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(out.status.success(), "{said}{}", String::from_utf8_lossy(&out.stderr));
    let summary = said.split("SUMMARY").nth(1).unwrap_or(&said);
    println!("{summary}"); // for who asks for it: cargo test --test held_to_document -- --nocapture
    let cases = summary
        .lines()
        .find_map(|line| line.trim().strip_suffix("skipped")?.split(' ').next()?.parse::<u32>().ok());
    assert!(cases.is_some_and(|cases| cases > 1000), "{summary}");
    assert_eq!(api.get("/readyz").await.status, 200);
}
