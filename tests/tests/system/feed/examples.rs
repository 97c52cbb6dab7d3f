//! Examples of the trainer feed, run unmodified by plain Python.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use env_core::log::Precision;
use env_core::rollout::replay;
use env_core::{ActionLog, Recipe, Scenario, Seed, StopReason, task};
use serde_json::{Value, json};
use system_tests::{Server, log_to_json};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Returns the Python interpreters for an example: the system's without packages, and one with msgpack if installed.
fn pythons() -> Vec<PathBuf> {
    let packed = Path::new(ROOT).join("target/openenv-venv/bin/python");
    let plain = PathBuf::from("python3");
    if packed.exists() {
        return vec![plain, packed];
    }
    assert!(std::env::var_os("SPARRING_TRAINERS").is_none(), "scripts/openenv-venv has not been run");
    vec![plain]
}

async fn run_example(python: &Path, name: &str, args: &[&str]) -> Output {
    let mut command = Command::new(python);
    command.arg(Path::new(ROOT).join("examples").join(name)).args(args).env("PYTHONDONTWRITEBYTECODE", "1");
    tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap()
}

fn successful_stdout(output: &Output) -> String {
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{out}{err}");
    out.into_owned()
}

#[tokio::test]
async fn columns_example_is_accepted_unless_forged() {
    let server = Server::start().await;
    let url = server.api().base().to_owned();
    for python in pythons() {
        let args = ["--url", &url, "--rounds", "2", "--groups", "30"];
        let stdout = successful_stdout(&run_example(&python, "columns.py", &args).await);
        assert_eq!(
            stdout.lines().filter(|line| line.ends_with("30 claimed, 16 audited, accepted")).count(),
            2,
            "{stdout}"
        );
        assert!(stdout.contains("\"episodes\": 60") && stdout.contains("replayed 32"), "{stdout}");
    }
    let args = ["--url", &url, "--rounds", "1", "--groups", "20", "--forge"];
    let stdout = successful_stdout(&run_example(Path::new("python3"), "columns.py", &args).await);
    assert!(stdout.contains("refused its log replays to") || stdout.contains(", refused"), "{stdout}");
    assert!(stdout.contains("\"refused\": 20"), "{stdout}");
}

#[tokio::test]
async fn groups_example_reports_and_renews() {
    let server = Server::start().await;
    let api = server.api();
    // A lease takes about as long as its time to live, so that the example renews it. A group takes a sixtieth of that, so that
    // a slow machine does not lose the lease during a group.
    let args = ["--url", api.base(), "--rounds", "2", "--groups", "60", "--group-size", "4", "--ttl", "4"];
    let stdout = successful_stdout(&run_example(Path::new("python3"), "groups.py", &args).await);
    assert_eq!(
        stdout.lines().filter(|line| line.contains("240 episodes, mean score 0.")).count(),
        2,
        "{stdout}"
    );
    let last = stdout.lines().last().unwrap();
    assert!(last.contains(": level 0, 480 episodes, "), "{stdout}");
    let run = last.split(' ').nth(1).unwrap().trim_end_matches(':');
    let leases = api.get(&format!("/v1/runs/{run}/leases")).await.expect(200);
    let states: Vec<&Value> =
        leases["leases"].as_array().unwrap().iter().map(|lease| &lease["status"]).collect();
    assert_eq!(states, ["done", "done"], "{leases}");
}

#[tokio::test]
async fn events_example_prints_events() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"strategy": "ladder", "id": "run", "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let lease = api.lease("run", json!({"groups": 2})).await;
    let _ = api.report("run", lease.results("hold")).await;
    let args = ["--url", api.base(), "--run", "run", "--after", "0", "--count", "5"];
    let stdout = successful_stdout(&run_example(Path::new("python3"), "events.py", &args).await);
    let kinds: Vec<&str> = stdout.lines().map(|line| line.split(' ').nth(2).unwrap()).collect();
    assert_eq!(kinds, ["run:", "lease:", "group:", "group:", "lease:"], "{stdout}");
}

/// A second implementation of the world, written in Python from docs/worlds/kessler.md, gives the same scores. The tolerance is
/// 1e-9: sine and cosine may differ in the last bit, which fifty steps raise to at most 1e-12 of a position, and a score is a
/// count of steps.
#[test]
fn validate_plain_python_survival_scores() {
    let levels: [(f64, f64, f64); 4] =
        [(25.0, 0.0, 100.0), (75.0, 0.8, 20.0), (125.0, 1.0, 4.0), (200.0, 1.5, 1.5)];
    let kicks = [(0.0, 0.0), (0.2, -0.1), (-0.4, 0.3)];
    let (mut cases, mut expected) = (Vec::new(), Vec::new());
    for (at, (debris, spread, fuel)) in levels.into_iter().enumerate() {
        let params = [("debris", debris), ("spread", spread), ("fuel", fuel)];
        let recipe = Recipe::with_params(task("kessler/survival").unwrap(), params.into_iter()).unwrap();
        let recipe = std::sync::Arc::new(recipe);
        for seed in 0..6u64 {
            let kick = kicks[(at + seed as usize) % kicks.len()];
            let scenario = Scenario::new(recipe.clone(), Seed::user(1000 * at as u64 + seed).unwrap());
            let mut log = ActionLog::new(2, Precision::F64);
            (0..3).for_each(|satellite| log.push_entry(satellite, &[kick.0, kick.1]));
            log.end_step();
            log.stopped = Some(StopReason::TooLate);
            let steps = log_to_json(&log)["steps"][0].clone();
            cases.push(
                json!({"recipe": scenario.recipe().to_json(), "seed": scenario.seed().get(), "burns": steps}),
            );
            expected.push(replay(&scenario, &log).unwrap().score);
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
    let input = Value::Array(cases).to_string();
    std::io::Write::write_all(&mut python.stdin.take().unwrap(), input.as_bytes()).unwrap();
    let output = python.wait_with_output().unwrap();
    let scores: Vec<f64> =
        String::from_utf8(output.stdout).unwrap().lines().map(|line| line.parse().unwrap()).collect();
    assert_eq!(scores.len(), expected.len());
    for (at, (ours, theirs)) in expected.iter().zip(&scores).enumerate() {
        assert!((ours - theirs).abs() < 1e-9, "scenario {at}: {ours} here, {theirs} there");
    }
    assert!(expected.iter().any(|score| *score < 0.9), "the test needs lost satellites: {expected:?}");
}
