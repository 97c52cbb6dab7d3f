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

/// Creates two runs with equal settings, `a` and `b`, and `c` with another strategy; their agents hold.
async fn create_compared_runs(server: &Server) {
    let api = server.api();
    for (seed, (id, strategy)) in [("a", "ladder"), ("b", "ladder"), ("c", "uniform")].into_iter().enumerate()
    {
        let settings = json!({"strategy": strategy, "id": id, "name": format!("{HTML_NAME} {id}"), "seed": seed + 1, "tasks": ["kessler/survival"], "design": {"designer": "off"}});
        let _ = api.post("/v1/runs", settings).await.expect(201);
        for _ in 0..3 {
            let lease = api.lease(id, json!({"groups": 8})).await;
            let _ = api.report(id, lease.results("hold")).await;
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn report_compares_runs() {
    let server = Server::start().await;
    create_compared_runs(&server).await;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (db, html, pdf, figures) =
        (server.db_path().display().to_string(), path("c.html"), path("c.pdf"), path("figures"));
    let output = report(&["a", "b", "c", "--db", &db, "--out", &html, "--figures", &figures]);
    assert!(output.status.success(), "{output:?}");
    assert!(
        String::from_utf8_lossy(&output.stdout).contains("comparison of 3 runs in 2 groups"),
        "{output:?}"
    );
    let page = std::fs::read_to_string(&html).unwrap();
    for text in [
        "Level of survival",
        "Success rate of survival",
        "strategy ladder (2 runs)",
        "curriculum.strategy",
        "<svg",
    ] {
        assert!(page.contains(text), "{text}");
    }
    assert!(!page.contains("<script") && page.contains("&lt;script&gt;"), "names are escaped");
    let csv = std::fs::read_to_string(format!("{figures}/kessler-survival-success.csv")).unwrap();
    let head = csv.lines().next().unwrap();
    assert!(head.starts_with("episodes of the task,strategy ladder (2 runs),"), "{head}");
    assert_eq!(head.matches("strategy").count(), 4, "a mean with two bounds, and one run: {head}");
    assert!(csv.lines().count() > 100);
    let svg = std::fs::read_to_string(format!("{figures}/kessler-survival-level.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("strategy ladder (2 runs)"), "{svg}");
    let png = std::fs::read(format!("{figures}/kessler-survival-level.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 10_000, "{} bytes", png.len());
    // One run has a PDF document, too; the groups and the axis are the user's choice.
    let one = report(&["a", "--db", &db, "--out", &pdf, "--x", "steps"]);
    assert!(String::from_utf8_lossy(&one.stdout).contains("comparison of 1 run with"), "{one:?}");
    let output = report(&["a", "b", "c", "--db", &db, "--out", &pdf, "--x", "hours", "--group-by", "run"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("comparison of 3 runs with"), "{output:?}");
    for file in [pdf, format!("{figures}/kessler-survival-skill.pdf")] {
        let bytes = std::fs::read(&file).unwrap();
        assert!(bytes.starts_with(b"%PDF-") && bytes.trim_ascii_end().ends_with(b"%%EOF"), "{file}");
    }
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
        (vec!["young", "young", "--db", &db, "--out", &out], "run young is named twice"),
        (vec!["young", "--db", &db, "--out", "report.txt"], "report.txt must end in .html or .pdf"),
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
