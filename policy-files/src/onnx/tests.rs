//! Tests with small models of the Python package, with the outputs that torch computes for them, and with faulty files.
//! `scripts/onnx-fixtures` writes the files.

use std::path::PathBuf;

use env_core::batch::{Autoreset, BatchBuffers, BatchOutput};
use env_core::policy_factory::PolicyFactory;
use env_core::rollout::{replay, roll_out};
use env_core::{Recipe, Scenario, Seed};
use serde_json::Value;

use super::*;

fn fixture(file: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/onnx").join(file)
}

fn model(name: &str) -> OnnxPolicy {
    let bytes = std::fs::read(fixture(&format!("{name}.onnx"))).unwrap();
    OnnxPolicy::parse(format!("onnx:{name}"), &bytes).unwrap()
}

fn scenario(task: &str, level: usize, seed: u64) -> Scenario {
    let recipe = Recipe::at_level(env_core::task(task).unwrap(), level).unwrap();
    Scenario::new(recipe, Seed::user(seed).unwrap())
}

/// All numbers of nested lists, in order.
fn flat(value: &Value) -> Vec<f32> {
    match value {
        Value::Array(rows) => rows.iter().flat_map(flat).collect(),
        number => vec![number.as_f64().unwrap() as f32],
    }
}

/// Returns the network of a model for a task, and the names of its observation's parts.
fn network(policy: &OnnxPolicy, scenario: &Scenario) -> (Network, Vec<&'static str>) {
    let batch = episode::create_batch(scenario, &policy.settings, false).unwrap();
    let network = Network::prepare(
        &policy.model,
        &policy.settings.grid(scenario.task()),
        &batch.parts(),
        batch.shape(),
    )
    .unwrap();
    (network, batch.parts().iter().map(|part| part.name).collect())
}

#[test]
fn validate_outputs_against_torch() {
    for (name, task, rows_of_agents) in [
        ("tracks_continuous", "kessler/survival", true),
        ("tracks_discrete", "kessler/survival", true),
        ("normalized", "kessler/survival", true),
        ("joint_tracks", "kessler/survival", false),
        ("telemetry_kessler", "kessler/survival", false),
        ("state_docking", "docking/single", true),
        ("telemetry_docking", "docking/multiagent", false),
    ] {
        let text = std::fs::read_to_string(fixture(&format!("{name}.json"))).unwrap();
        let sample: Value = serde_json::from_str(&text).unwrap();
        let scenario =
            Scenario::new(Recipe::new(env_core::task(task).unwrap()).unwrap(), Seed::user(1).unwrap());
        let (network, parts) = network(&model(name), &scenario);
        let agents = scenario.task().agents(scenario.recipe()) as usize;
        let inputs = &sample["inputs"];
        let rows = sample["outputs"].as_array().unwrap();
        for (row, expected) in rows.iter().enumerate() {
            let observation: Vec<f32> = match inputs.get("observations") {
                // All agents see the row of the sample.
                Some(samples) if rows_of_agents => flat(&samples[row]).repeat(agents),
                Some(samples) => flat(&samples[row]),
                None => parts.iter().flat_map(|part| flat(&inputs[*part][row])).collect(),
            };
            let output = network.evaluate(&observation).unwrap();
            let wanted = if rows_of_agents { flat(expected).repeat(agents) } else { flat(expected) };
            let found = output.to_plain_array_view::<f32>().unwrap();
            let worst = found.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(found.len() == wanted.len() && worst < 1e-4, "{name}, row {row}: {worst}");
        }
        assert_eq!(network.is_discrete(), name == "tracks_discrete");
    }
}

/// The environment that writes the observations has the state of the episode at every step: its score is that of a replay.
#[test]
fn own_environment_follows_the_episode() {
    for (name, task, level) in [
        ("tracks_continuous", "kessler/survival", 6),
        ("tracks_discrete", "kessler/eco_station", 4),
        ("telemetry_kessler", "kessler/rendezvous", 3),
        ("state_docking", "docking/multiagent", 5),
    ] {
        let (policy, scenario) = (model(name), scenario(task, level, 11));
        policy.check(scenario.task()).unwrap();
        let rollout = roll_out(&scenario, &mut *policy.create(&scenario, 0).unwrap()).unwrap();
        assert_eq!(replay(&scenario, &rollout.log).unwrap(), rollout.outcome);
        assert!(!policy.is_stochastic(scenario.task()));

        let (network, _) = network(&policy, &scenario);
        let mut batch = episode::create_batch(&scenario, &policy.settings, network.is_discrete()).unwrap();
        let mut buffers = BatchBuffers::new(batch.shape(), Autoreset::Disabled);
        let mut executed = vec![0.0; batch.shape().agents * batch.shape().action];
        batch.reset(None, &mut buffers.observations).unwrap();
        let mut steps = 0;
        while !buffers.done[0] {
            let actions = network.act(&buffers.observations).unwrap();
            let output = BatchOutput { executed_actions: &mut executed, ..buffers.output() };
            batch.step(&actions, output).unwrap();
            let space = scenario.task().action_space();
            let logged = rollout.log.step(steps).by_agent(&space, batch.shape().agents);
            assert!(
                logged.iter().map(|value| *value as f32).eq(executed.iter().copied()),
                "{name}, step {steps}"
            );
            steps += 1;
        }
        assert_eq!(steps, rollout.outcome.steps as usize, "{name}");
        let score = batch.running_episode(0).unwrap().score;
        assert!((score - rollout.outcome.score).abs() < 1e-4, "{name}: {score} {:?}", rollout.outcome);
    }
}

#[test]
fn faulty_models_are_refused_with_a_reason() {
    let task = env_core::task("kessler/survival").unwrap();
    let scenario = scenario("kessler/survival", 3, 1);
    for (file, reason) in [
        ("truncated", "failed to decode"),
        ("input_width", "its input has the shape [?, 73]; the observation of an agent has 72 values"),
        ("output_width", "its output has the shape [3, 3] of F32; 3 agents need [3, 2] of F32"),
        ("unknown_operator", "Steer"),
        ("not_finite", "step 1: the action of agent 0 is not finite"),
    ] {
        let bytes = std::fs::read(fixture(&format!("faulty/{file}.onnx"))).unwrap();
        let found = match OnnxPolicy::parse("onnx:faulty".to_owned(), &bytes) {
            Err(reason) => reason,
            Ok(policy) => match policy.check(task) {
                Err(error) => error.to_string(),
                Ok(()) => {
                    let mut episode = policy.create(&scenario, 0).unwrap();
                    roll_out(&scenario, &mut *episode).unwrap_err().to_string()
                }
            },
        };
        assert!(found.contains(reason), "{file}: {found}");
    }
    let docking = env_core::task("docking/single").unwrap();
    let other = model("tracks_continuous").check(docking).unwrap_err().to_string();
    assert!(
        other.contains("the model declares the world kessler@1, and the task is of docking@1"),
        "{other}"
    );
    let bytes = std::fs::read(fixture("faulty/no_metadata.onnx")).unwrap();
    OnnxPolicy::parse("onnx:plain".to_owned(), &bytes).unwrap().check(task).unwrap();
    assert!(OnnxPolicy::parse("onnx:empty".to_owned(), b"").unwrap_err().contains("graph"));
}

/// A damaged file is refused, or acts; it never ends the process.
#[test]
fn damaged_models_do_not_panic() {
    let scenario = scenario("kessler/survival", 0, 1);
    let bytes = std::fs::read(fixture("tracks_continuous.onnx")).unwrap();
    let mut state = 7_u64;
    let mut next = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {})); // a caught panic prints nothing
    let mut refused = 0;
    for _ in 0..300 {
        let mut damaged = bytes.clone();
        for _ in 0..=next(4) {
            let at = next(damaged.len());
            damaged[at] ^= 1 << next(8);
        }
        let acts = OnnxPolicy::parse("onnx:damaged".to_owned(), &damaged)
            .and_then(|policy| policy.create(&scenario, 0).map_err(|error| error.to_string()))
            .and_then(|mut policy| roll_out(&scenario, &mut *policy).map_err(|error| error.to_string()));
        refused += usize::from(acts.is_err());
    }
    std::panic::set_hook(hook);
    assert!((1..300).contains(&refused), "{refused} of 300");
}
