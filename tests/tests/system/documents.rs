//! What the documents say is true: the README's trainer runs, the OpenAPI document is the one that is committed.

use std::process::Command;

use serde_json::Value;
use system_tests::{Server, binary};

#[test]
fn the_openapi_document_is_the_committed_one() {
    insta::assert_json_snapshot!("openapi", orchestrator::http::openapi());
}

#[test]
fn the_example_layouts_pass_the_gate() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/layouts.json");
    let out =
        Command::new(binary()).args(["design", "--layouts", file, "--format", "json"]).output().unwrap();
    assert!(out.status.success(), "{out:?}");
    let told: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(told["layouts"][0]["admitted"], true, "{told}");
    assert!(told["layouts"][0]["reference"].as_f64() > told["layouts"][0]["hold"].as_f64());
}

/// `scripts/designer-pictures` draws them.
#[test]
fn the_pictures_of_the_designers_guide_are_what_is_drawn() {
    let root = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let into = tempfile::tempdir().unwrap();
    let file = root.join("examples/layouts.json");
    let line = ["design", "--layouts", file.to_str().unwrap(), "--svg", into.path().to_str().unwrap()];
    let out = Command::new(binary()).args(line).output().unwrap();
    assert!(out.status.success(), "{out:?}");
    let guide = std::fs::read_to_string(root.join("docs/designer.md")).unwrap();
    let mut drawn = 0;
    for entry in std::fs::read_dir(into.path()).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if let Some(picture) = name.strip_suffix(".svg") {
            let committed =
                std::fs::read_to_string(root.join("docs/designer").join(&name)).unwrap_or_default();
            let fresh = std::fs::read_to_string(into.path().join(&name)).unwrap();
            assert!(committed == fresh, "docs/designer/{name} is old: run scripts/designer-pictures");
            drawn += usize::from(guide.contains(&format!("(designer/{picture}.svg)")));
        }
    }
    assert!(drawn >= 4, "the guide shows {drawn} of them");
}

#[tokio::test]
async fn the_readmes_trainer_runs() {
    let readme = include_str!("../../../README.md");
    let (_, rest) = readme.split_once("```python\n").unwrap();
    let (program, _) = rest.split_once("```").unwrap();
    let lines = program.lines().filter(|line| !line.trim().is_empty()).count();
    assert!(lines <= 20, "the README promises 20 lines; these are {lines}");
    let server = Server::start().await;
    let program = program.replace("http://127.0.0.1:8700", server.api().base());
    let out =
        tokio::task::spawn_blocking(move || Command::new("python3").args(["-c", &program]).output().unwrap())
            .await
            .unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let runs = server.api().get("/v1/runs").await.expect(200);
    let id = runs["runs"][0]["id"].as_str().unwrap();
    let mastery = server.api().get(&format!("/v1/runs/{id}/mastery")).await.expect(200);
    let [plain, designed] = ["plain", "designed"].map(|of| &mastery["tasks"][0][of]);
    let episodes = [plain, designed].map(|sums| sums["episodes"].as_u64().unwrap()).iter().sum::<u64>();
    assert_eq!(episodes, 20 * 8 * 4, "{mastery}");
    assert!(plain["success"].as_f64().unwrap() > 0.2, "{plain}");
}
