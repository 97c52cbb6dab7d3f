//! Policy files of the server's folder: evaluated on a suite, rolled out for a run, and refused with a reason.

use std::path::Path;

use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::{ApiClient, Server, wait_for};

const FIXTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/onnx");

/// Starts a server whose policy folder has some fixtures and the reflex of a demo.
async fn start(folder: &Path) -> Server {
    for file in
        ["tracks_continuous.onnx", "state_docking.onnx", "faulty/truncated.onnx", "faulty/not_finite.onnx"]
    {
        let name = Path::new(file).file_name().unwrap();
        std::fs::copy(Path::new(FIXTURES).join(file), folder.join(name)).unwrap();
    }
    let numbers = |task: &str| vec![0.5; env_core::task(task).unwrap().reflex().names.len()];
    let reflex = json!({"tasks": {"docking/single": {"numbers": numbers("docking/single")},
                                  "docking/multiagent": {"numbers": numbers("docking/multiagent")}}});
    std::fs::write(folder.join("demo.json"), reflex.to_string()).unwrap();
    let path = folder.to_owned();
    Server::with_config(move |config| Config {
        policy_folder: policy_files::PolicyFolder::new(path.clone()),
        ..config
    })
    .await
}

async fn wait_until_ended(api: &ApiClient, id: &str) -> Value {
    wait_for("the evaluation has ended", async || {
        let evaluation = api.get(&format!("/v1/evaluations/{id}")).await.expect(200);
        (evaluation["state"] != "running").then_some(evaluation)
    })
    .await
}

#[tokio::test(flavor = "multi_thread")]
async fn server_evaluates_policy_files() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path()).await;
    let api = server.api();
    for policy in ["onnx:state_docking.onnx", "reflex:demo.json"] {
        let request = json!({"policy": policy, "suite": "docking-heldout-v1"});
        let created = api.post("/v1/evaluations", request).await.expect(201);
        // The name has the hash of the contents, and one rollout suffices.
        let named = created["policy"].as_str().unwrap();
        assert!(named.starts_with(&format!("{policy}@")) && named.len() == policy.len() + 13, "{named}");
        assert_eq!((&created["stochastic"], &created["rollouts"]), (&json!(false), &json!(1)));
        let ended = wait_until_ended(&api, created["id"].as_str().unwrap()).await;
        assert_eq!((&ended["state"], &ended["scenarios_done"]), (&json!("complete"), &json!(384)), "{ended}");
        let request = json!({"policy": named, "suite": "docking-heldout-v1"});
        let again = api.post("/v1/evaluations", request).await.expect(201);
        assert_eq!(again["policy"], named);
        let cancel = format!("/v1/evaluations/{}/cancel", again["id"].as_str().unwrap());
        let _ = api.post(&cancel, json!({})).await.expect(200);
    }
    // The command line computes the same numbers.
    let direct = std::process::Command::new(system_tests::sparring_binary())
        .args(["eval", "--json", "--suite", "docking-heldout-v1", "--policy"])
        .arg(format!("onnx:{FIXTURES}/state_docking.onnx"))
        .output()
        .unwrap();
    let direct: Value = serde_json::from_slice(&direct.stdout).unwrap();
    let stored = api.get("/v1/evaluations/eval-1").await.expect(200);
    let score = |report: &Value| {
        let rows = report["rows"].as_array().unwrap();
        let row = rows.iter().find(|row| row["task"] == "docking/single" && row["part"] == "all");
        row.unwrap()["score"]["mean"].as_f64().unwrap()
    };
    assert!((score(&direct) - score(&stored)).abs() < 1e-12, "{} {}", score(&direct), score(&stored));
}

#[tokio::test(flavor = "multi_thread")]
async fn server_rolls_out_a_policy_file_for_a_run() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path()).await;
    let api = server.api();
    let settings =
        json!({"id": "r", "tasks": ["kessler/survival"], "group_size": 2, "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let policy =
        json!({"policy": "onnx:tracks_continuous.onnx", "version": 3, "max_unacknowledged_groups": 2});
    let set = api.send_json("PUT", "/v1/runs/r/policy", policy).await.expect(200);
    assert_eq!(set["policy"], "onnx:tracks_continuous.onnx");
    let state = wait_for("two groups are rolled out", async || {
        let state = api.get("/v1/runs/r/policy").await.expect(200);
        (state["groups"].as_i64() >= Some(2)).then_some(state)
    })
    .await;
    assert_eq!((&state["failed"], &state["last_error"]), (&json!(0), &Value::Null));
    let feed = api.get("/v1/runs/r/trajectories?limit=1").await.expect(200);
    let episode = &feed["groups"][0]["episodes"][0];
    assert!(episode["steps"].as_array().is_some_and(|steps| !steps.is_empty()), "{feed}");
    assert_eq!(feed["groups"][0]["policy_version"], 3);

    // A file that disappears is an error of the run, and the run continues when it is back.
    let away = folder.path().join("tracks_continuous.onnx");
    std::fs::rename(&away, folder.path().join("away")).unwrap();
    let ids: Vec<&Value> = feed["groups"].as_array().unwrap().iter().map(|group| &group["id"]).collect();
    let _ = api.post("/v1/runs/r/trajectories/ack", json!({ "ids": ids })).await.expect(200);
    wait_for("the missing file is shown", async || {
        let state = api.get("/v1/runs/r/policy").await.expect(200);
        let message = state["last_error"]["message"].as_str().unwrap_or_default().to_owned();
        message.contains("tracks_continuous.onnx cannot be read").then_some(())
    })
    .await;
}

#[tokio::test]
async fn invalid_policy_files_are_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path()).await;
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "r", "tasks": ["kessler/survival"]})).await.expect(201);
    let mut problems = Vec::new();
    for policy in [
        "onnx:missing.onnx",
        "onnx:../demo.json",
        "onnx:/etc/passwd",
        "onnx:.hidden",
        "onnx:",
        "onnx:truncated.onnx",
        "onnx:state_docking.onnx",
        "onnx:tracks_continuous.onnx@000000000000",
        "onnx:demo.json",
        "reflex:demo.json",
        "reflex:truncated.onnx",
        "golf",
    ] {
        for request in [
            api.send_json("PUT", "/v1/runs/r/policy", json!({ "policy": policy })).await,
            api.post("/v1/evaluations", json!({"policy": policy, "suite": "kessler-heldout-v1"})).await,
        ] {
            let problem = request.expect(422);
            assert_eq!(problem["field"], "policy");
            problems.push(format!("{policy}: {}", problem["detail"].as_str().unwrap()));
        }
    }
    let text = problems.join("\n");
    assert!(!text.contains(&folder.path().display().to_string()), "the folder is the operator's: {text}");
    insta::assert_snapshot!(text);

    let plain = Server::start().await;
    let request = json!({"policy": "onnx:tracks_continuous.onnx"});
    let problem = plain.api().post("/v1/evaluations", request).await.expect(422);
    assert!(problem["detail"].as_str().unwrap().contains("--policy-folder"), "{problem}");
}
