//! Tests of prompts and of the actions read from replies. The whole-system tests run episodes over a real socket.

use std::fmt::Write;

use env_core::task::StepReport;
use env_core::{JointAction, Recipe, Scenario, Seed, TaskSpec};
use llm::{LlmConfig, WallClock};
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;

const TASKS: [&str; 3] = ["kessler/survival", "kessler/eco_station", "kessler/rendezvous"];

/// Returns the time step of a task after `steps` steps of *hold*.
fn time_step_after(task: &'static dyn TaskSpec, seed: u64, steps: u32) -> TimeStep {
    let scenario = Scenario::new(Recipe::new(task).unwrap(), Seed::user(seed).unwrap());
    let mut episode = task.start(&scenario).unwrap();
    let mut report = StepReport::default();
    for _ in 0..steps {
        episode.step(JointAction::HOLD, &mut report).unwrap();
    }
    let mut observation = episode.telemetry();
    observation.as_object_mut().unwrap().retain(|name, _| name != "reward" && name != "done");
    TimeStep { observation, reward: report.reward, done: report.done }
}

fn prompt_of(id: &str, format: ObservationFormat) -> TaskPrompt {
    let task = env_core::task(id).unwrap();
    TaskPrompt::new(ActionCodec::new(task), format)
}

fn docking() -> ActionCodec {
    ActionCodec::new(env_core::task("docking/single").unwrap())
}

fn read(text: &str, codec: &ActionCodec) -> Result<Value, String> {
    let mut config = LlmConfig::new("http://127.0.0.1:1/v1", "m", WallClock::new(|| 0));
    config.key = Some("sk-secret".to_owned().into());
    reply::parse_action(text, codec, &config)
}

#[test]
fn prompts_hold_the_rules_and_the_observation() {
    for (id, steps) in [(TASKS[0], 0), (TASKS[1], 6), (TASKS[2], 3), ("kessler/formation", 1)] {
        let prompt = prompt_of(id, ObservationFormat::Compact);
        let user = prompt.user(steps + 1, &time_step_after(env_core::task(id).unwrap(), 1, steps));
        let name = id.split('/').next_back().unwrap();
        insta::assert_snapshot!(
            format!("prompt_{name}"),
            format!("{}\n\n{}\n\n=====\n\n{user}", prompt.version(), prompt.system())
        );
    }
    let task = env_core::task("docking/single").unwrap();
    let prompt = TaskPrompt::new(docking(), ObservationFormat::Compact);
    let user = prompt.user(1, &time_step_after(task, 1, 0));
    insta::assert_snapshot!("prompt_docking", format!("{}\n\n=====\n\n{user}", prompt.system()));
    insta::assert_snapshot!(prompt.repair("burns is missing"), @r#"Your answer is not a valid action: burns is missing. Answer with one JSON object and nothing else; {"thrusts":[]} does nothing."#);
}

#[test]
fn raw_format_repeats_the_servers_observation() {
    let task = env_core::task(TASKS[0]).unwrap();
    let time_step = time_step_after(task, 3, 2);
    let prompt = prompt_of(TASKS[0], ObservationFormat::Raw);
    assert!(prompt.user(3, &time_step).contains(&time_step.observation.to_string()));
    assert_eq!(prompt.version(), "kessler-2-raw");
    // An observation of another world is formatted as JSON with fewer digits.
    let odd = TimeStep { observation: json!({"x": [1.234_567_8, {"n": 7}]}), reward: 0.0, done: false };
    assert!(
        prompt_of(TASKS[0], ObservationFormat::Compact).user(1, &odd).contains(r#"{"x":[1.235,{"n":7}]}"#)
    );
}

/// Placeholders inside values are not replaced.
#[test]
fn placeholders_in_observations_stay_text() {
    let odd = TimeStep { observation: json!({"a": "{{step}} {{telemetry}} {{"}), reward: 0.0, done: false };
    let user = prompt_of(TASKS[0], ObservationFormat::Compact).user(4, &odd);
    assert!(user.contains("{{step}} {{telemetry}} {{") && user.starts_with("Step 4 of 50."), "{user}");
}

/// docs/guides/language-models.md lists the mean length of a message over 20 seeds, after five steps, in both formats.
#[test]
fn docs_list_the_length_of_both_formats() {
    let mut table = String::new();
    for id in TASKS {
        let task = env_core::task(id).unwrap();
        let mean = |format| {
            let prompt = prompt_of(id, format);
            let length = |seed| prompt.user(6, &time_step_after(task, seed, 5)).chars().count();
            (0..20).map(length).sum::<usize>() / 20
        };
        let (compact, raw) = (mean(ObservationFormat::Compact), mean(ObservationFormat::Raw));
        let system = prompt_of(id, ObservationFormat::Compact).system().chars().count();
        assert!(2 * compact < raw, "{id}: {compact} and {raw}");
        writeln!(table, "| {id} | {system} | {compact} | {raw} | {:.1} |", raw as f64 / compact as f64)
            .unwrap();
    }
    let docs = include_str!("../../docs/guides/language-models.md");
    assert!(docs.contains(&table), "docs/guides/language-models.md should have\n{table}");
}

#[test]
fn actions_are_found_in_any_reply_form() {
    let codec = ActionCodec::new(env_core::task(TASKS[0]).unwrap());
    let burn = r#"{"satellite_id": 1, "delta_vx": 0.5, "delta_vy": -0.25}"#;
    let expected = json!({"burns": [{"satellite_id": 1, "delta_vx": 0.5, "delta_vy": -0.25}]});
    for text in [
        format!(r#"{{"burns": [{burn}]}}"#),
        format!(r#"{{"action": {{"burns": [{burn}]}}}}"#),
        format!("[{burn}]"),
        format!(
            "I might hold, {{\"burns\": []}}, but [satellite 1] is in danger:\n```json\n{{\"burns\": [{burn}]}}\n```"
        ),
        format!(r#"<think>{{"burns": [9]}} no…</think>{{"thought": "up", "burns": [{burn}]}}"#),
        r#"{"burns": [{"satellite_id": 1.0, "delta_vx": "0.5", "delta_vy": -0.25, "why": "up"}]}"#.to_owned(),
    ] {
        assert_eq!(read(&text, &codec).as_ref(), Ok(&expected), "{text}");
    }
    assert_eq!(read("[]", &codec).unwrap(), codec.hold());
    assert_eq!(codec.hold(), json!({"burns": []}));
    // The text has its fields in the order of the schema.
    let text = r#"{"burns":[{"satellite_id":1,"delta_vx":0.5,"delta_vy":-0.25}]}"#;
    assert_eq!(codec.to_text(&expected), text);
    // Numbers are clamped as the environments clamp them.
    let far = read(r#"{"burns":[{"satellite_id":0,"delta_vx":-7,"delta_vy":1e300}]}"#, &codec).unwrap();
    assert_eq!(far, json!({"burns": [{"satellite_id": 0, "delta_vx": -1.0, "delta_vy": 1.0}]}));
    let thrust = r#"{"thrusts":[{"deputy_id":0,"thrust_x":0.5,"thrust_y":0.0,"thrust_z":-1.0}]}"#;
    assert_eq!(read(thrust, &docking()).unwrap(), serde_json::from_str::<Value>(thrust).unwrap());
}

#[test]
fn invalid_actions_name_the_reason() {
    let codec = ActionCodec::new(env_core::task(TASKS[0]).unwrap());
    let error_of = |text: &str| read(text, &codec).unwrap_err();
    let many =
        json!({"burns": vec![json!({"satellite_id": 0, "delta_vx": 0, "delta_vy": 0}); 65]}).to_string();
    insta::assert_snapshot!(
        [
            error_of(""),
            error_of("I hold."),
            error_of("42"),
            error_of(r#"{"burn": []}"#),
            error_of(r#"{"burns": {}}"#),
            error_of(r#"{"burns": "none"}"#),
            error_of(&many),
            error_of(r#"{"burns": [{"satellite_id": 3, "delta_vx": 0, "delta_vy": 0}]}"#),
            error_of(r#"{"burns": [{"satellite_id": 0.5, "delta_vx": 0, "delta_vy": 0}]}"#),
            error_of(r#"{"burns": [{"satellite_id": 0, "delta_vx": "sk-s\u0065cret", "delta_vy": 0}]}"#),
            error_of(r#"{"burns": [{"satellite_id": 0, "delta_vx": NaN, "delta_vy": 0}]}"#),
            error_of(r#"{"burns": [{"satellite_id": 0, "delta_vx": 0}]}"#),
            error_of(r#"{"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy"#),
            error_of(&"x".repeat(300_000)),
            read(r#"{"thrusts": [{"deputy_id": "a"}]}"#, &docking()).unwrap_err(),
            read(r#"{"thrust": [1, 0, 0]}"#, &docking()).unwrap_err(),
        ]
        .join("\n")
    );
}

#[test]
fn log_steps_are_encoded_in_the_worlds_form() {
    let action = JointAction { agents: &[2], values: &[0.5, -0.25, 7.0] };
    assert_eq!(
        docking().encode(action),
        json!({"thrusts": [{"deputy_id": 2, "thrust_x": 0.5, "thrust_y": -0.25, "thrust_z": 1.0}]})
    );
    assert_eq!(docking().encode(JointAction::HOLD), docking().hold());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// Any action that is read from a reply is read again as the same action, and *hold* always is an action.
    #[test]
    fn parsed_actions_are_stable(text in r#"[{}\[\]":,0-9a-z_. \\\-]{0,80}"#, cut in 0usize..90) {
        let codec = ActionCodec::new(env_core::task(TASKS[0]).unwrap());
        let burns = r#"{"burns": [{"satellite_id": 1, "delta_vx": 0.5, "delta_vy": -0.25}]} "#;
        let mixed = format!("{}{text}", burns.chars().take(cut).collect::<String>());
        for text in [&text, &mixed] {
            if let Ok(action) = read(text, &codec) {
                prop_assert_eq!(codec.extract(action.clone()), Some(Ok(action)));
            }
        }
        prop_assert_eq!(codec.extract(codec.hold()), Some(Ok(codec.hold())));
    }
}
