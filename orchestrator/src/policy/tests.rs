//! What a model is told and how its words are read. How it flies is tested by the whole-system tests, over a real socket.

use std::fmt::Write;

use designer::llm::{LlmConfig, WallClock};
use env_core::task::StepReport;
use env_core::{JointAction, Recipe, Scenario, Seed, TaskSpec};
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;

const TASKS: [&str; 3] = ["kessler/survival", "kessler/eco_station", "kessler/rendezvous"];

/// What a task looks like after so many steps of holding.
fn seen(task: &'static dyn TaskSpec, seed: u64, steps: u32) -> Seen {
    let scenario = Scenario::new(Recipe::new(task).unwrap(), Seed::user(seed).unwrap());
    let mut episode = task.start(&scenario).unwrap();
    let mut report = StepReport::default();
    for _ in 0..steps {
        episode.step(JointAction::HOLD, &mut report).unwrap();
    }
    let mut observation = episode.telemetry();
    observation.as_object_mut().unwrap().retain(|name, _| name != "reward" && name != "done");
    Seen { observation, reward: report.reward, done: report.done }
}

fn kessler(id: &str, telemetry: Telemetry) -> Briefing {
    let task = env_core::task(id).unwrap();
    Briefing::new(Actions::new(task), telemetry)
}

fn docking() -> Actions {
    Actions::new(env_core::task("docking/single").unwrap())
}

fn read(text: &str, actions: &Actions) -> Result<Value, String> {
    let mut config = LlmConfig::new("http://127.0.0.1:1/v1", "m", WallClock::new(|| 0));
    config.key = Some("sk-secret".to_owned().into());
    answer::read(text, actions, &config)
}

#[test]
fn a_model_is_told_the_rules_and_what_is_seen() {
    for (id, steps) in [(TASKS[0], 0), (TASKS[1], 6), (TASKS[2], 3), ("kessler/formation", 1)] {
        let briefing = kessler(id, Telemetry::Compact);
        let user = briefing.user(steps + 1, &seen(env_core::task(id).unwrap(), 1, steps));
        let name = id.split('/').next_back().unwrap();
        insta::assert_snapshot!(
            format!("told_{name}"),
            format!("{}\n\n{}\n\n=====\n\n{user}", briefing.version(), briefing.system())
        );
    }
    let task = env_core::task("docking/single").unwrap();
    let briefing = Briefing::new(docking(), Telemetry::Compact);
    let user = briefing.user(1, &seen(task, 1, 0));
    insta::assert_snapshot!("told_docking", format!("{}\n\n=====\n\n{user}", briefing.system()));
    insta::assert_snapshot!(briefing.repair("burns is missing"), @r#"That is no action: burns is missing. Answer with one JSON object and nothing else; {"thrusts":[]} does nothing."#);
}

#[test]
fn raw_telemetry_is_what_the_server_said() {
    let task = env_core::task(TASKS[0]).unwrap();
    let seen = seen(task, 3, 2);
    let briefing = kessler(TASKS[0], Telemetry::Raw);
    assert!(briefing.user(3, &seen).contains(&seen.observation.to_string()));
    assert_eq!(briefing.version(), "kessler-1-raw");
    // An observation that is none of its world is told as it is, in fewer digits.
    let odd = Seen { observation: json!({"x": [1.234_567_8, {"n": 7}]}), reward: 0.0, done: false };
    assert!(kessler(TASKS[0], Telemetry::Compact).user(1, &odd).contains(r#"{"x":[1.235,{"n":7}]}"#));
}

/// Names within values are no places.
#[test]
fn what_a_server_says_stays_text() {
    let odd = Seen { observation: json!({"a": "{{step}} {{telemetry}} {{"}), reward: 0.0, done: false };
    let user = kessler(TASKS[0], Telemetry::Compact).user(4, &odd);
    assert!(user.contains("{{step}} {{telemetry}} {{") && user.starts_with("Step 4 of 50."), "{user}");
}

/// The mean length of a message over the first steps of an episode and over seeds, compact and raw: as docs/play.md tells it.
#[test]
fn the_docs_tell_how_much_shorter_compact_is() {
    let mut table = String::new();
    for id in TASKS {
        let task = env_core::task(id).unwrap();
        let mean = |telemetry| {
            let briefing = kessler(id, telemetry);
            let all: usize = (0..20).map(|seed| briefing.user(6, &seen(task, seed, 5)).chars().count()).sum();
            all / 20
        };
        let (compact, raw) = (mean(Telemetry::Compact), mean(Telemetry::Raw));
        let system = kessler(id, Telemetry::Compact).system().chars().count();
        assert!(2 * compact < raw, "{id}: {compact} and {raw}");
        writeln!(table, "| {id} | {system} | {compact} | {raw} | {:.1} |", raw as f64 / compact as f64)
            .unwrap();
    }
    let docs = include_str!("../../../docs/play.md");
    assert!(docs.contains(&table), "docs/play.md should have\n{table}");
}

#[test]
fn actions_are_found_wherever_they_are() {
    let actions = Actions::new(env_core::task(TASKS[0]).unwrap());
    let burn = r#"{"satellite_id": 1, "delta_vx": 0.5, "delta_vy": -0.25}"#;
    let wanted = json!({"burns": [{"satellite_id": 1, "delta_vx": 0.5, "delta_vy": -0.25}]});
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
        assert_eq!(read(&text, &actions).as_ref(), Ok(&wanted), "{text}");
    }
    assert_eq!(read("[]", &actions).unwrap(), actions.hold());
    assert_eq!(actions.hold(), json!({"burns": []}));
    // Written as whoever is held to the schema writes it.
    let text = r#"{"burns":[{"satellite_id":1,"delta_vx":0.5,"delta_vy":-0.25}]}"#;
    assert_eq!(actions.text(&wanted), text);
    // As the environments clamp it.
    let far = read(r#"{"burns":[{"satellite_id":0,"delta_vx":-7,"delta_vy":1e300}]}"#, &actions).unwrap();
    assert_eq!(far, json!({"burns": [{"satellite_id": 0, "delta_vx": -1.0, "delta_vy": 1.0}]}));
    let thrust = r#"{"thrusts":[{"deputy_id":0,"thrust_x":0.5,"thrust_y":0.0,"thrust_z":-1.0}]}"#;
    assert_eq!(read(thrust, &docking()).unwrap(), serde_json::from_str::<Value>(thrust).unwrap());
}

#[test]
fn what_is_no_action_says_why() {
    let actions = Actions::new(env_core::task(TASKS[0]).unwrap());
    let of = |text: &str| read(text, &actions).unwrap_err();
    let many =
        json!({"burns": vec![json!({"satellite_id": 0, "delta_vx": 0, "delta_vy": 0}); 65]}).to_string();
    insta::assert_snapshot!(
        [
            of(""),
            of("I hold."),
            of("42"),
            of(r#"{"burn": []}"#),
            of(r#"{"burns": {}}"#),
            of(r#"{"burns": "none"}"#),
            of(&many),
            of(r#"{"burns": [{"satellite_id": 3, "delta_vx": 0, "delta_vy": 0}]}"#),
            of(r#"{"burns": [{"satellite_id": 0.5, "delta_vx": 0, "delta_vy": 0}]}"#),
            of(r#"{"burns": [{"satellite_id": 0, "delta_vx": "sk-s\u0065cret", "delta_vy": 0}]}"#),
            of(r#"{"burns": [{"satellite_id": 0, "delta_vx": NaN, "delta_vy": 0}]}"#),
            of(r#"{"burns": [{"satellite_id": 0, "delta_vx": 0}]}"#),
            of(r#"{"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy"#),
            of(&"x".repeat(300_000)),
            read(r#"{"thrusts": [{"deputy_id": "a"}]}"#, &docking()).unwrap_err(),
            read(r#"{"thrust": [1, 0, 0]}"#, &docking()).unwrap_err(),
        ]
        .join("\n")
    );
}

#[test]
fn steps_of_a_log_are_said_as_the_world_says_them() {
    let action = JointAction { agents: &[2], values: &[0.5, -0.25, 7.0] };
    assert_eq!(
        docking().value(action),
        json!({"thrusts": [{"deputy_id": 2, "thrust_x": 0.5, "thrust_y": -0.25, "thrust_z": 1.0}]})
    );
    assert_eq!(docking().value(JointAction::HOLD), docking().hold());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// Whatever a model says, what is read from it is an action, and doing nothing always is one.
    #[test]
    fn whatever_is_said_is_read_or_refused(text in r#"[{}\[\]":,0-9a-z_. \\\-]{0,80}"#, cut in 0usize..90) {
        let actions = Actions::new(env_core::task(TASKS[0]).unwrap());
        let burns = r#"{"burns": [{"satellite_id": 1, "delta_vx": 0.5, "delta_vy": -0.25}]} "#;
        let mixed = format!("{}{text}", burns.chars().take(cut).collect::<String>());
        for text in [&text, &mixed] {
            if let Ok(action) = read(text, &actions) {
                prop_assert_eq!(actions.meant(action.clone()), Some(Ok(action)));
            }
        }
        prop_assert_eq!(actions.meant(actions.hold()), Some(Ok(actions.hold())));
    }
}
