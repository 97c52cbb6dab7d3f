//! `sparring report` writes one page about a run while a server uses the database.

use std::process::{Command, Output};

use serde_json::json;
use system_tests::{Server, sparring_binary};

use crate::design::wait_for_critiques;

const HTML_NAME: &str = "<script>alert(1)</script> \"'&";

fn report(args: &[&str]) -> Output {
    Command::new(sparring_binary()).arg("report").args(args).output().expect("it runs")
}

#[tokio::test(flavor = "multi_thread")]
async fn report_is_one_self_contained_page() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"strategy": "ladder", "id": "run", "name": HTML_NAME, "seed": 7, "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    for _ in 0..3 {
        let lease = api.lease("run", json!({"groups": 32})).await;
        let _ = api.report("run", lease.results("hold")).await;
    }
    let failures = wait_for_critiques(&api).await;
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    let (db, out_arg) = (server.db_path().display().to_string(), out.display().to_string());
    // The run by its name, and without a name because it is the only one.
    for run in [&[HTML_NAME][..], &[]] {
        let output = report(&[run, &["--db", &db, "--out", &out_arg]].concat());
        assert!(output.status.success(), "{output:?}");
    }
    let output = report(&["run", "--db", &db, "--out", &out_arg]);
    assert!(output.status.success(), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("96 episodes of run"), "{output:?}");
    let page = std::fs::read_to_string(&out).unwrap();
    for text in [
        "kessler/survival",
        "Mastery and success",
        "Sampler: ladder",
        "Rungs of the sampler (10)",
        "Failure modes",
        "collision",
        "Rules of the curriculum",
        "<svg",
    ] {
        assert!(page.contains(text), "{text}");
    }
    assert!(!page.contains("<script") && page.contains("&lt;script&gt;"), "names are escaped");
    for reference in ["src=", "@import", "href=\"http", "url("] {
        assert!(!page.contains(reference), "the page refers to another resource: {reference}");
    }
    // The failure profile has collisions, as the page shows.
    let modes = failures["tasks"][0]["modes"].as_array().unwrap();
    let collisions = modes.iter().find(|mode| mode["mode"] == "collision").unwrap();
    assert!(collisions["count"].as_i64().unwrap() > 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn report_explains_invalid_arguments() {
    let server = Server::start().await;
    let _ = server.api().post("/v1/runs", json!({"strategy": "ladder", "id": "young"})).await.expect(201);
    let folder = tempfile::tempdir().unwrap();
    let (db, out) =
        (server.db_path().display().to_string(), folder.path().join("r.html").display().to_string());
    for (args, text) in [
        (vec!["unknown", "--db", &db, "--out", &out], "there is no run \"unknown\""),
        (vec!["young", "--db", "/nowhere/x.sqlite3", "--out", &out], "/nowhere/x.sqlite3 does not exist"),
        (
            vec!["young", "--db", &db, "--out", "/nowhere/r.html"],
            "/nowhere/r.html cannot be written: its folder does not exist",
        ),
        (vec!["yuong", "--db", &db, "--out", &out], "did you mean young?"),
    ] {
        let output = report(&args);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {output:?}");
        assert!(stderr.contains(text) && !stderr.contains("panicked"), "{args:?}: {stderr}");
    }
    let output = report(&["young", "--db", &db, "--out", &out]);
    assert!(output.status.success(), "a run without results has a report, too: {output:?}");
    assert!(std::fs::read_to_string(&out).unwrap().contains("No results yet."));
}
