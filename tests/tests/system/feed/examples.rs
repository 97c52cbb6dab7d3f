//! The examples are run as they stand, by plain Python.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use env_core::log::Precision;
use env_core::rollout::replay;
use env_core::{ActionLog, Recipe, Scenario, Seed, Stopped, task};
use serde_json::{Value, json};
use system_tests::{Server, wire};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Pythons to run an example with: the system's, with nothing but its standard library, and one with msgpack.
fn pythons() -> Vec<PathBuf> {
    let packed = Path::new(ROOT).join("target/openenv-venv/bin/python");
    let plain = PathBuf::from("python3");
    if packed.exists() {
        return vec![plain, packed];
    }
    assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
    vec![plain]
}

async fn example(python: &Path, name: &str, line: &[&str]) -> Output {
    let mut command = Command::new(python);
    command.arg(Path::new(ROOT).join("examples").join(name)).args(line).env("PYTHONDONTWRITEBYTECODE", "1");
    tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap()
}

fn said(output: &Output) -> String {
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{out}{err}");
    out.into_owned()
}

#[tokio::test]
async fn columns_are_accepted_where_they_are_true_and_refused_where_not() {
    let server = Server::start().await;
    let url = server.api().base().to_owned();
    for python in pythons() {
        let line = ["--url", &url, "--rounds", "2", "--groups", "30"];
        let told = said(&example(&python, "columns.py", &line).await);
        assert_eq!(
            told.lines().filter(|line| line.ends_with("30 claimed, 16 audited, accepted")).count(),
            2,
            "{told}"
        );
        assert!(told.contains("\"episodes\": 60") && told.contains("replayed 32"), "{told}");
    }
    let line = ["--url", &url, "--rounds", "1", "--groups", "20", "--forge"];
    let told = said(&example(Path::new("python3"), "columns.py", &line).await);
    assert!(told.contains("refused its log replays to") || told.contains(", refused"), "{told}");
    assert!(told.contains("\"refused\": 20"), "{told}");
}

#[tokio::test]
async fn groups_are_flown_reported_and_learnt_from() {
    let server = Server::start().await;
    let api = server.api();
    // A lease of a second is renewed between groups.
    let line = ["--url", api.base(), "--rounds", "2", "--groups", "4", "--group-size", "3", "--ttl", "1"];
    let told = said(&example(Path::new("python3"), "groups.py", &line).await);
    assert_eq!(told.lines().filter(|line| line.contains("12 episodes earn 0.")).count(), 2, "{told}");
    let last = told.lines().last().unwrap();
    assert!(last.contains(": level 0, 24 episodes, "), "{told}");
    let run = last.split(' ').nth(1).unwrap().trim_end_matches(':');
    let leases = api.get(&format!("/v1/runs/{run}/leases")).await.expect(200);
    let states: Vec<&Value> =
        leases["leases"].as_array().unwrap().iter().map(|lease| &lease["status"]).collect();
    assert_eq!(states, ["done", "done"], "{leases}");
}

#[tokio::test]
async fn events_are_listened_to() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"id": "run", "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let lease = api.lease("run", json!({"groups": 2})).await;
    let results = lease.episodes().iter().map(|(id, s)| system_tests::result(id, s, "hold")).collect();
    let _ = api.report("run", results).await;
    let line = ["--url", api.base(), "--run", "run", "--after", "0", "--count", "5"];
    let told = said(&example(Path::new("python3"), "events.py", &line).await);
    let kinds: Vec<&str> = told.lines().map(|line| line.split(' ').nth(2).unwrap()).collect();
    assert_eq!(kinds, ["run:", "lease:", "group:", "group:", "lease:"], "{told}");
}

/// The world as docs/kessler.md describes it, written down a second time, scores as this one does. 1e-9: sine and cosine may
/// differ in the last bit, which fifty steps raise to 1e-12 of a position at most, and a score is a count of steps.
#[test]
fn validate_plain_python_survival_scores() {
    let levels: [(f64, f64, f64); 4] =
        [(25.0, 0.0, 100.0), (75.0, 0.8, 20.0), (125.0, 1.0, 4.0), (200.0, 1.5, 1.5)];
    let kicks = [(0.0, 0.0), (0.2, -0.1), (-0.4, 0.3)];
    let (mut asked, mut wanted) = (Vec::new(), Vec::new());
    for (at, (debris, spread, fuel)) in levels.into_iter().enumerate() {
        let params = [("debris", debris), ("spread", spread), ("fuel", fuel)];
        let recipe = Recipe::with_params(task("kessler/survival").unwrap(), params.into_iter()).unwrap();
        let recipe = std::sync::Arc::new(recipe);
        for seed in 0..6u64 {
            let kick = kicks[(at + seed as usize) % kicks.len()];
            let scenario = Scenario::new(recipe.clone(), Seed::user(1000 * at as u64 + seed).unwrap());
            let mut log = ActionLog::new(2, Precision::F64);
            (0..3).for_each(|satellite| log.act(satellite, &[kick.0, kick.1]));
            log.end_step();
            log.stopped = Some(Stopped::TooLate);
            let steps = wire(&log)["steps"][0].clone();
            asked.push(
                json!({"recipe": scenario.recipe().to_json(), "seed": scenario.seed().get(), "burns": steps}),
            );
            wanted.push(replay(&scenario, &log).unwrap().score);
        }
    }
    let script = "import sys, json; sys.path.insert(0, sys.argv[1]); import kessler\n\
        for each in json.load(sys.stdin):\n\
        \x20   episode = kessler.Survival(each['recipe'], each['seed'])\n\
        \x20   while not episode.done: episode.step([] if episode.step_number else each['burns'])\n\
        \x20   print(episode.score)";
    let mut python = Command::new("python3")
        .args(["-c", script])
        .arg(Path::new(ROOT).join("examples"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .stdin(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let input = Value::Array(asked).to_string();
    std::io::Write::write_all(&mut python.stdin.take().unwrap(), input.as_bytes()).unwrap();
    let output = python.wait_with_output().unwrap();
    let scores: Vec<f64> =
        String::from_utf8(output.stdout).unwrap().lines().map(|line| line.parse().unwrap()).collect();
    assert_eq!(scores.len(), wanted.len());
    for (at, (ours, theirs)) in wanted.iter().zip(&scores).enumerate() {
        assert!((ours - theirs).abs() < 1e-9, "scenario {at}: {ours} here, {theirs} there");
    }
    assert!(wanted.iter().any(|score| *score < 0.9), "some lose somebody: {wanted:?}");
}
