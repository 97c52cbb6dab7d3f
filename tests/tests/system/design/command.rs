//! `sparring design` with a running server: layouts aim at the failures of a run's policy.

use std::process::{Command, Output};

use serde_json::{Value, json};
use system_tests::{ApiClient, Server, episode_result, sparring_binary};

use super::{wait_for_critiques, wait_for_response};

const TASK: &str = "kessler/rendezvous";

/// Creates a run, reports episodes of a holding policy and waits until they are in the failure profile.
async fn create_run_with_failures(api: &ApiClient) {
    let settings = json!({
        "id": "run", "seed": 11, "strategy": "ladder", "placement": false, "tasks": [TASK],
        "task_settings": {TASK: {"physics": {"contact": "swept"}}}
    });
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let lease = api.lease("run", json!({"groups": 12, "purpose": "train"})).await;
    let results =
        lease.episodes().into_iter().map(|(episode, scenario)| episode_result(&episode, &scenario, "hold"));
    api.report("run", results.collect()).await;
    wait_for_critiques(api).await;
}

async fn run_design(line: Vec<String>) -> Output {
    let run = move || Command::new(sparring_binary()).arg("design").args(line).output().unwrap();
    tokio::task::spawn_blocking(run).await.unwrap()
}

fn strings(line: &[&str]) -> Vec<String> {
    line.iter().map(|word| (*word).to_owned()).collect()
}

#[tokio::test]
async fn layouts_aim_at_the_failures_of_a_run() {
    let server = Server::start().await;
    create_run_with_failures(&server.api()).await;
    let url = server.api().base().to_owned();
    let run_args = |more: &[&str]| strings(&[&["--run", "run", "--url", &url, "--json"], more].concat());

    let process = run_design(run_args(&["--dry-run"])).await;
    assert!(process.status.success(), "{process:?}");
    let output: Value = serde_json::from_slice(&process.stdout).unwrap();
    let profile = server.api().get("/v1/runs/run/failure_profiles").await.expect(200)["tasks"][0].clone();
    assert_eq!((&output["task"], &output["level"]), (&json!(TASK), &json!(0)));
    assert_eq!(output["recipe"]["physics"]["contact"], "swept");
    assert_eq!(output["profile"]["criticised"], profile["criticised"]);
    assert!(output["profile"]["criticised"].as_u64() > Some(0));

    let process = run_design(run_args(&["--n", "2", "--level", "4"])).await;
    assert!(process.status.success(), "{process:?}");
    let output: Value = serde_json::from_slice(&process.stdout).unwrap();
    assert_eq!(output["summary"]["admitted"], 2);
    for layout in output["layouts"].as_array().unwrap().iter().filter(|layout| layout["admitted"] == true) {
        assert_eq!(
            layout["scenario"]["physics"]["contact"], "swept",
            "layouts use the physics options of the run"
        );
    }

    known_layouts_are_excluded(&server.api(), run_args).await;
    let process = run_design(strings(&["--run", "unknown", "--url", &url])).await;
    let stderr = String::from_utf8(process.stderr).unwrap();
    assert!(
        process.status.code() == Some(2)
            && stderr.contains("there is no run \"unknown\"")
            && stderr.lines().count() == 1,
        "{stderr}"
    );
    let process = run_design(run_args(&["--task", "kessler/survival"])).await;
    let stderr = String::from_utf8(process.stderr).unwrap();
    assert!(
        process.status.code() == Some(2) && stderr.contains("its tasks are kessler/rendezvous"),
        "{stderr}"
    );
}

/// Checks that the gate and the prompt know the layouts that the run already has.
async fn known_layouts_are_excluded(api: &ApiClient, run_args: impl Fn(&[&str]) -> Vec<String>) {
    let created =
        api.post("/v1/runs/run/designs", json!({"count": 3, "designer": "procedural"})).await.expect(202);
    let path = format!("/v1/runs/run/designs/requests/{}", created["id"].as_str().unwrap());
    wait_for_response(api, &path, |request| request["state"] == "done").await;
    let process = run_design(run_args(&["--n", "2"])).await;
    let output: Value = serde_json::from_slice(&process.stdout).unwrap();
    let layouts = output["layouts"].as_array().unwrap().iter().filter(|layout| layout["admitted"] == true);
    let novelty: Vec<f64> = layouts.map(|layout| layout["novelty"].as_f64().unwrap()).collect();
    assert!(
        novelty.len() == 2 && novelty.iter().all(|novelty| *novelty >= 0.05),
        "novelty is measured against the layouts of the run: {novelty:?}"
    );
    let prompt = run_design(run_args(&["--dry-run", "--designer", "llm"])).await;
    let prompt: Value = serde_json::from_slice(&prompt.stdout).unwrap();
    let admitted = prompt["prompt"].as_str().unwrap().matches("admitted, without episodes").count();
    assert_eq!(admitted, 3, "{prompt}");
}
