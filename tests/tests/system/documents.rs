//! Committed documents match the program: OpenAPI document, example layouts, pictures of the guide.

use std::process::Command;

use serde_json::Value;
use system_tests::sparring_binary;

#[test]
fn openapi_document_matches_snapshot() {
    insta::assert_json_snapshot!("openapi", orchestrator::http::openapi());
}

#[test]
fn example_layouts_pass_the_gate() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/layouts.json");
    let process =
        Command::new(sparring_binary()).args(["design", "--layouts", file, "--json"]).output().unwrap();
    assert!(process.status.success(), "{process:?}");
    let output: Value = serde_json::from_slice(&process.stdout).unwrap();
    assert_eq!(output["layouts"][0]["admitted"], true, "{output}");
    assert!(output["layouts"][0]["reference"].as_f64() > output["layouts"][0]["hold"].as_f64());
}

/// Compares the committed pictures with a new drawing; `scripts/designer-pictures` updates them.
#[test]
fn designer_guide_pictures_are_up_to_date() {
    let root = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let into = tempfile::tempdir().unwrap();
    let file = root.join("examples/layouts.json");
    let line = ["design", "--layouts", file.to_str().unwrap(), "--svg", into.path().to_str().unwrap()];
    let process = Command::new(sparring_binary()).args(line).output().unwrap();
    assert!(process.status.success(), "{process:?}");
    let guide = std::fs::read_to_string(root.join("docs/reference/design-language.md")).unwrap();
    let mut shown = 0;
    for entry in std::fs::read_dir(into.path()).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if let Some(picture) = name.strip_suffix(".svg") {
            let committed =
                std::fs::read_to_string(root.join("docs/pictures/design").join(&name)).unwrap_or_default();
            let fresh = std::fs::read_to_string(into.path().join(&name)).unwrap();
            assert!(
                committed == fresh,
                "docs/pictures/design/{name} is out of date: run scripts/designer-pictures"
            );
            shown += usize::from(guide.contains(&format!("(../pictures/design/{picture}.svg)")));
        }
    }
    assert!(shown >= 4, "the guide shows only {shown} pictures");
}
