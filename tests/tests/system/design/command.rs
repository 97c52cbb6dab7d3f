//! `sparring design` against a running service: what a run's agent fails at is what its layouts go for.

use std::process::{Command, Output};
use std::time::Duration;

use serde_json::{Value, json};
use system_tests::{Api, Server, binary, result};

const TASK: &str = "kessler/rendezvous";

/// A run whose agent held on some leased scenarios, once what that shows is in its profile.
async fn flown(api: &Api) {
    let wish = json!({
        "id": "run", "seed": 11, "placement": false, "tasks": [TASK],
        "task_settings": {TASK: {"physics": {"contact": "swept"}}}
    });
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let lease = api.lease("run", json!({"groups": 12, "purpose": "train"})).await;
    let results = lease.episodes().into_iter().map(|(episode, scenario)| result(&episode, &scenario, "hold"));
    api.report("run", results.collect()).await;
    for _ in 0..600 {
        if api.get("/v1/runs/run").await.expect(200)["critique"]["waiting"] == 0 {
            return;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("the critique does not catch up");
}

async fn design(line: Vec<String>) -> Output {
    let run = move || Command::new(binary()).arg("design").args(line).output().unwrap();
    tokio::task::spawn_blocking(run).await.unwrap()
}

fn words(line: &[&str]) -> Vec<String> {
    line.iter().map(|word| (*word).to_owned()).collect()
}

#[tokio::test]
async fn layouts_are_designed_for_a_run() {
    let server = Server::start().await;
    flown(&server.api()).await;
    let url = server.api().base().to_owned();
    let ask = |more: &[&str]| words(&[&["--run", "run", "--url", &url, "--format", "json"], more].concat());

    let out = design(ask(&["--dry-run"])).await;
    assert!(out.status.success(), "{out:?}");
    let told: Value = serde_json::from_slice(&out.stdout).unwrap();
    let profile = server.api().get("/v1/runs/run/failures").await.expect(200)["tasks"][0].clone();
    assert_eq!((&told["task"], &told["level"]), (&json!(TASK), &json!(0)));
    assert_eq!(told["recipe"]["physics"]["contact"], "swept");
    assert_eq!(told["profile"]["criticised"], profile["criticised"]);
    assert!(told["profile"]["criticised"].as_u64() > Some(0));

    let out = design(ask(&["--n", "2", "--level", "4"])).await;
    assert!(out.status.success(), "{out:?}");
    let told: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(told["summary"]["admitted"], 2);
    for layout in told["layouts"].as_array().unwrap().iter().filter(|layout| layout["admitted"] == true) {
        assert_eq!(layout["scenario"]["physics"]["contact"], "swept", "the run's physics holds");
    }

    known_ones_are_left_out(&server.api(), ask).await;
    let out = design(words(&["--run", "nobody", "--url", &url])).await;
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.code() == Some(2) && said.contains("404") && said.lines().count() == 1, "{said}");
    let out = design(ask(&["--task", "kessler/survival"])).await;
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.code() == Some(2) && said.contains("its tasks are kessler/rendezvous"), "{said}");
}

/// What the run has already is known to the gate, and told to who designs.
async fn known_ones_are_left_out(api: &Api, ask: impl Fn(&[&str]) -> Vec<String>) {
    let asked = api.post("/v1/runs/run/designs", json!({"n": 3, "designer": "procedural"})).await.expect(202);
    let path = format!("/v1/runs/run/designs/asks/{}", asked["id"].as_str().unwrap());
    while api.get(&path).await.expect(200)["state"] != "done" {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let out = design(ask(&["--n", "2"])).await;
    let told: Value = serde_json::from_slice(&out.stdout).unwrap();
    let layouts = told["layouts"].as_array().unwrap().iter().filter(|layout| layout["admitted"] == true);
    let apart: Vec<f64> = layouts.map(|layout| layout["novelty"].as_f64().unwrap()).collect();
    assert!(
        apart.len() == 2 && apart.iter().all(|apart| *apart >= 0.05),
        "compared with the run's: {apart:?}"
    );
    let prompt = design(ask(&["--dry-run", "--designer", "llm"])).await;
    let prompt: Value = serde_json::from_slice(&prompt.stdout).unwrap();
    let admitted = prompt["prompt"].as_str().unwrap().matches("admitted; nobody has flown it yet").count();
    assert_eq!(admitted, 3, "{prompt}");
}
