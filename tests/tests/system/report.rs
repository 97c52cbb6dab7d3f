//! `sparring report`: a run on one page, of a database that a server is using.

use std::process::{Command, Output};

use serde_json::json;
use system_tests::{Server, binary, result};

use crate::design::caught_up;

const HOSTILE: &str = "<script>alert(1)</script> \"'&";

fn report(args: &[&str]) -> Output {
    Command::new(binary()).arg("report").args(args).output().expect("it runs")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_is_told_on_one_page_that_needs_nothing_else() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"id": "run", "name": HOSTILE, "seed": 7, "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    for _ in 0..3 {
        let lease = api.lease("run", json!({"groups": 32})).await;
        let results = lease.episodes().iter().map(|(id, scenario)| result(id, scenario, "hold")).collect();
        let _ = api.report("run", results).await;
    }
    let failures = caught_up(&api).await;
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    let (db, out_arg) = (server.db().display().to_string(), out.display().to_string());
    let told = report(&["run", "--db", &db, "--out", &out_arg]);
    assert!(told.status.success(), "{told:?}");
    assert!(String::from_utf8_lossy(&told.stdout).contains("96 episodes of run"), "{told:?}");
    let page = std::fs::read_to_string(&out).unwrap();
    for words in [
        "kessler/survival",
        "Success on contested scenarios",
        "What defeats it",
        "collision",
        "By which rules",
        "<svg",
    ] {
        assert!(page.contains(words), "{words}");
    }
    assert!(!page.contains("<script") && page.contains("&lt;script&gt;"), "what people wrote is text");
    for outside in ["src=", "@import", "href=\"http", "url("] {
        assert!(!page.contains(outside), "{outside}: it needs something else");
    }
    // A rose says what the service says.
    let modes = failures["tasks"][0]["modes"].as_array().unwrap();
    let collisions = modes.iter().find(|mode| mode["mode"] == "collision").unwrap();
    assert!(collisions["count"].as_i64().unwrap() > 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_told_is_refused_in_a_sentence() {
    let server = Server::start().await;
    let _ = server.api().post("/v1/runs", json!({"id": "young"})).await.expect(201);
    let folder = tempfile::tempdir().unwrap();
    let (db, out) = (server.db().display().to_string(), folder.path().join("r.html").display().to_string());
    for (args, words) in [
        (vec!["nobody", "--db", &db, "--out", &out], "there is no run nobody"),
        (vec!["young", "--db", "/nowhere/x.sqlite3", "--out", &out], "/nowhere/x.sqlite3"),
        (vec!["young", "--db", &db, "--out", "/nowhere/r.html"], "there is no folder /nowhere"),
        (vec!["NOT AN ID", "--db", &db, "--out", &out], "NOT AN ID"),
    ] {
        let told = report(&args);
        let said = String::from_utf8_lossy(&told.stderr);
        assert_eq!(told.status.code(), Some(2), "{args:?}: {told:?}");
        assert!(said.contains(words) && !said.contains("panicked"), "{args:?}: {said}");
    }
    let told = report(&["young", "--db", &db, "--out", &out]);
    assert!(told.status.success(), "a run in which nothing happened is a page, too: {told:?}");
    assert!(std::fs::read_to_string(&out).unwrap().contains("Nothing came back yet."));
}
