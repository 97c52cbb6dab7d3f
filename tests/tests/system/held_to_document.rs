//! schemathesis, from the package index, asks a running server what its OpenAPI document says may be asked, and what may not: no
//! answer that is not documented, and none that is a failure. `tests/clients/held.py` does it, by hand too.

use std::path::Path;
use std::process::Command;

use system_tests::binary;

/// Cases that are made up for each operation, beside those that cover its bounds; SPARRING_SCHEMATHESIS for more by hand.
const EXAMPLES: &str = "6";

#[test]
fn nothing_is_answered_that_is_not_documented() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let python = root.join("target/openenv-venv/bin/python");
    if !python.exists() {
        assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
        eprintln!("skipped: `make test` installs schemathesis first");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let examples = std::env::var("SPARRING_SCHEMATHESIS").unwrap_or_else(|_| EXAMPLES.to_owned());
    let out = Command::new(python)
        .arg(root.join("tests/clients/held.py"))
        .args(["--examples", &examples, "--sparring"])
        .arg(binary())
        .current_dir(folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(out.status.success(), "{said}{}", String::from_utf8_lossy(&out.stderr));
    println!("{}", said.split("SUMMARY").nth(1).unwrap_or(&said)); // for who asks for it: cargo test -- --nocapture
    let asked = said.lines().find_map(|line| line.split_once(" requests to ")?.0.parse::<u32>().ok());
    assert!(asked.is_some_and(|asked| asked > 1000), "{said}");
}
