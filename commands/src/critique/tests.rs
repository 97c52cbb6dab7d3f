//! Tests of the subcommand's input and output.

use clap::Parser;
use env_core::critique::{Judgement, Measure, Remedy};
use env_core::{Recipe, Seed};

use super::*;
use crate::output::OutputTarget;

#[derive(Parser)]
struct CritiqueCommand {
    #[command(flatten)]
    args: Args,
}

fn args(line: &[&str]) -> Args {
    CritiqueCommand::try_parse_from([&["critique"], line].concat()).unwrap().args
}

fn scenario() -> Scenario {
    let recipe = Recipe::new(env_core::task("kessler/survival").unwrap()).unwrap();
    Scenario::new(recipe, Seed::user(7).unwrap())
}

fn collision() -> Failure {
    Failure {
        mode: "collision",
        agent: 1,
        step: 17,
        encounter: Some(Encounter {
            body: 4,
            bearing_deg: 93.4,
            bearing_inertial_deg: Some(12.0),
            relative_speed: 2.25,
            first_visible_step: Some(0),
            steps_left: 16,
            avoidable: Some(true),
            cheapest_avoidance: Some(Remedy { step: 14, values: vec![0.1, -0.05], cost: 0.559 }),
        }),
        orbit_angle_deg: None,
        measures: Vec::new(),
        explanation: "debris 4 hit satellite 1 at step 17, from ahead; a burn at step 14 would have saved it"
            .to_owned(),
    }
}

fn shown(actions: Vec<ActionVerdict>) -> CritiqueReport {
    let hit = collision();
    let unseen = Encounter {
        avoidable: None,
        first_visible_step: None,
        cheapest_avoidance: None,
        ..hit.encounter.clone().unwrap()
    };
    let fragment = Failure {
        mode: "fragment",
        step: 18,
        encounter: Some(Encounter { steps_left: 0, ..unseen }),
        explanation: "a fragment hit satellite 2".to_owned(),
        agent: 2,
        ..hit.clone()
    };
    let measure = |name, value| Measure { name, value, unit: "" };
    let remedy =
        vec![measure("avoidable", 1.0), measure("cheapest_step", 9.0), measure("cheapest_cost", 0.25)];
    let decay = Failure {
        mode: "decay",
        step: 40,
        encounter: None,
        measures: remedy,
        explanation: String::new(),
        ..hit.clone()
    };
    let critique = Critique {
        failures: vec![hit, fragment, decay],
        actions,
        assessment: Judgement {
            value: -0.75,
            case: "missed",
            explanation: "Debris that was seen hit a satellite.".to_owned(),
        },
    };
    let flown = EpisodeOutcome {
        score: 0.441,
        total_reward: 0.44,
        steps: 50,
        lost: 2,
        goal: None,
        fuel_used: 3.5,
        time_s: None,
    };
    CritiqueReport { scenario: scenario(), flown, bracket: None, critique }
}

fn action(step: u32, verdict: Verdict, gain: f64) -> ActionVerdict {
    ActionVerdict { step, agent: 0, cost: 0.5, verdict, gain }
}

#[test]
fn people_read_a_table() {
    let few = vec![action(1, Verdict::Needed, 0.31), action(9, Verdict::Harmful, -0.125)];
    insta::assert_snapshot!("few_actions", shown(few).text_report().render(OutputTarget::Terminal(100)));
    let many = (1..=40).map(|step| action(step, Verdict::Harmless, f64::from(step) / 1000.0)).collect();
    let text = shown(many).text_report().render(OutputTarget::Terminal(100));
    assert!(text.contains("16 more with less effect; --json lists all of them."), "{text}");
    assert!(!text.contains("+0.016") && text.contains("+0.017"), "the smallest gains are left out: {text}");
    assert!(
        shown(Vec::new()).text_report().render(OutputTarget::Terminal(100)).contains("No action was judged.")
    );
}

#[test]
fn columns_without_values_are_left_out() {
    let free = ActionVerdict { cost: 0.0, ..action(3, Verdict::Needed, 0.2) };
    let mut report = shown(vec![free]);
    report.scenario = Scenario::new(
        Recipe::new(env_core::task("tasking/scanning").unwrap()).unwrap(),
        Seed::user(7).unwrap(),
    );
    for failure in &mut report.critique.failures {
        (failure.encounter, failure.orbit_angle_deg) = (None, Some(214.6));
        failure.measures.clear();
    }
    let text = report.text_report().render(OutputTarget::Terminal(100));
    assert!(text.contains("orbit angle") && text.contains("215°"), "{text}");
    for column in ["bearing", "speed", "avoidable", "cost"] {
        assert!(!text.contains(column), "{column} in {text}");
    }
}

#[test]
fn machines_read_an_object() {
    let json = shown(vec![action(1, Verdict::Needed, 0.31)]).json();
    assert_eq!(json["failures"][0]["encounter"]["cheapest_avoidance"]["step"], 14);
    assert_eq!(
        (&json["actions"][0]["verdict"], &json["assessment"]["case"]),
        (&json!("needed"), &json!("missed"))
    );
    assert_eq!((&json["skill"], &json["outcome"]["lost"]), (&Value::Null, &json!(2)));
}

#[test]
fn an_episode_is_read_from_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, value: Value| {
        let path = folder.path().join(name);
        std::fs::write(&path, value.to_string()).unwrap();
        path.display().to_string()
    };
    let mut hold = vec![json!([]); 50];
    hold[0] = json!([[0, 0.1, 0.0]]);
    let bare = file("scenario.json", scenario().to_json());
    let list = file("list.json", json!(hold));
    let whole = file("whole.json", json!({"steps": hold, "precision": "f32", "stopped": null}));
    let episode = json!({"episode": "ep", "scenario": scenario().to_json(), "actions": {"steps": hold}});
    let episode = file("episode.json", episode);
    for line in [
        &[&*bare, "--policy", "hold"][..],
        &[&bare, "--actions", &list],
        &[&bare, "--actions", &whole],
        &[&episode],
    ] {
        run(&args(line)).unwrap();
    }

    let fault = |line: &[&str]| format!("{:#}", run(&args(line)).unwrap_err());
    let error_of = |line: &[&str]| fault(line).replace(&folder.path().display().to_string(), "DIR");
    let stranger = file("stranger.json", json!({"task": "kessler/nothing", "seed": 1}));
    let halted = file("halted.json", json!({"steps": [], "stopped": "bored"}));
    let words = [
        error_of(&[&bare]),
        error_of(&["/no/such/file"]),
        error_of(&[&bare, "--policy", "missing"]),
        error_of(&[&stranger, "--policy", "hold"]).split(';').next().unwrap().to_owned(),
        error_of(&[&bare, "--actions", &halted]),
        error_of(&[&bare, "--actions", &bare]),
        error_of(&[&bare, "--actions", &file("short.json", json!([[]]))]),
    ];
    insta::assert_snapshot!("faults", words.join("\n"));
}

#[test]
fn the_telemetry_is_a_frame_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let (scenario, flight) = (folder.path().join("scenario.json"), folder.path().join("flight.jsonl"));
    let scenario_json = json!({"task": "kessler/survival", "seed": 7, "params": {"debris": 80},
                      "physics": {"warnings": "exact", "contact": "swept"}});
    std::fs::write(&scenario, scenario_json.to_string()).unwrap();
    let paths = [&scenario, &flight].map(|path| path.to_str().unwrap().to_owned());
    let line = args(&[&paths[0], "--policy", "hold", "--telemetry", &paths[1]]);
    assert_eq!(run(&line).unwrap(), ExitCode::SUCCESS);
    let text = std::fs::read_to_string(&flight).unwrap();
    let frames: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(frames.len() > 10 && frames.iter().enumerate().all(|(at, frame)| frame["step"] == at));
    let warned = |frame: &Value| frame["observation"]["conjunctions"].as_array().unwrap().len();
    assert!(frames.iter().map(warned).sum::<usize>() > 0, "80 pieces come near a satellite");
    let nowhere = args(&[&paths[0], "--policy", "hold", "--telemetry", "/nowhere/flight.jsonl"]);
    let error = format!("{:#}", run(&nowhere).unwrap_err());
    assert!(
        error.starts_with("/nowhere/flight.jsonl cannot be written: its folder does not exist"),
        "{error}"
    );
}
