//! Checks with schemathesis, from the package index, that every response of a server is as its OpenAPI document says.
//! The check itself is `tests/clients/openapi_conformance.py`, which can also be run by hand.
//! Tests start in alphabetical order. The name of this module lets its test, the longest one, start early.

use std::path::Path;
use std::process::Command;

use system_tests::sparring_binary;

/// Random cases for each operation, besides those that cover its bounds. `SPARRING_SCHEMATHESIS` overrides the number.
const DEFAULT_EXAMPLES: &str = "6";

#[test]
fn every_response_is_documented() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let python = root.join("target/openenv-venv/bin/python");
    if !python.exists() {
        assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
        eprintln!("skipped: `make test` installs schemathesis first");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let examples = std::env::var("SPARRING_SCHEMATHESIS").unwrap_or_else(|_| DEFAULT_EXAMPLES.to_owned());
    let output = Command::new(python)
        .arg(root.join("tests/clients/openapi_conformance.py"))
        .args(["--examples", &examples, "--sparring"])
        .arg(sparring_binary())
        .current_dir(folder.path())
        .output()
        .unwrap();
    let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{stdout}{}", String::from_utf8_lossy(&output.stderr));
    println!("{}", stdout.split("SUMMARY").nth(1).unwrap_or(&stdout)); // visible with: cargo test -- --nocapture
    let requests = stdout.lines().find_map(|line| line.split_once(" requests to ")?.0.parse::<u32>().ok());
    assert!(requests.is_some_and(|requests| requests > 1000), "{stdout}");
}
