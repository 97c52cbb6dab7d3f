//! Tests of verdicts, of their parser, and of the judge's prompt.

use env_core::log::Precision;
use env_core::task::StepReport;
use env_core::{ActionLog, Recipe, Scenario, Seed};
use llm::{LlmConfig, WallClock};

use super::*;
use crate::TimeStep;

fn config() -> LlmConfig {
    let mut config = LlmConfig::new("http://127.0.0.1:1/v1", "m", WallClock::new(|| 0));
    config.key = Some("sk-secret".to_owned().into());
    config
}

fn read(text: &str) -> Result<StepVerdict, String> {
    model::parse_verdict(text, &config())
}

/// The formula of the public kessler-env at its ends: praise keeps the reward, blame takes a third of it.
#[test]
fn rewards_are_weighted_as_in_kessler_env() {
    for (score, share) in [(1.0, 1.0), (0.0, 1.0 / 1.2), (-1.0, 0.8 / 1.2)] {
        let verdict = StepVerdict { score, reasoning: String::new() };
        assert!((verdict.weighted_reward(0.6) - 0.6 * share).abs() < 1e-15);
    }
}

#[test]
fn alert_is_one_short_line() {
    let verdict = |reasoning: &str| StepVerdict { score: -0.5, reasoning: reasoning.to_owned() };
    assert_eq!(verdict("It burnt\n  for\tnothing.").alert(), "[JUDGE]: It burnt for nothing. (Score: -0.50)");
    let long = verdict(&"é".repeat(5000)).alert();
    assert!(long.chars().count() < 340 && long.ends_with("é… (Score: -0.50)"), "{long}");
}

#[test]
fn verdict_needs_a_score_and_a_reason() {
    let good = read(r#"Well: {"score": 0.1} no, ```{"reasoning": " needed ", "score": 0.9}```"#).unwrap();
    assert_eq!((good.score, good.reasoning.as_str()), (0.9, "needed"));
    assert_eq!(read(r#"{"reasoning": "sk-secret", "score": -1}"#).unwrap().reasoning, "[key]");
    // Removing a control character assembles the key.
    assert_eq!(read(r#"{"reasoning": "sk\u0000-secret", "score": -1}"#).unwrap().reasoning, "[key]");
    let of = |text: &str| read(text).unwrap_err();
    insta::assert_snapshot!(
        [
            of(""),
            of("0.5"),
            of(r#"{"reasoning": "no score"}"#),
            of(r#"{"score": 0.5}"#),
            of(r#"{"reasoning": "", "score": 0.5}"#),
            of(r#"{"reasoning": "x", "score": 1.01}"#),
            of(r#"{"reasoning": "x", "score": "NaN"}"#),
            of(r#"{"reasoning": "x", "score": NaN}"#),
            of(r#"{"reasoning": "x", "score": 1e999}"#),
            of(r#"{"reasoning": "x", "score": null}"#),
            of(r#"{"reasoning": "x", "score": "sk-secret"}"#),
            of(&"x".repeat(300_000)),
        ]
        .join("\n")
    );
}

#[test]
fn judge_is_parsed_and_resolved() {
    for (word, judge) in [
        ("off", Judge::Off),
        ("", Judge::Off),
        ("False", Judge::Off),
        ("deterministic", Judge::Deterministic),
    ] {
        assert_eq!(parse_judge(word), Ok(judge), "{word}");
    }
    assert_eq!([parse_judge("true"), parse_judge("1"), parse_judge("LLM")], [const { Ok(Judge::Llm) }; 3]);
    assert!(parse_judge("maybe").is_err());
    // Without a model the rules judge.
    let judges = Judges::new(Judge::Deterministic, None);
    assert_eq!(judges.resolve(None), Judge::Deterministic);
    assert_eq!(judges.resolve(Some(Judge::Off)), Judge::Off);
    assert_eq!(judges.resolve(Some(Judge::Llm)), Judge::Deterministic);
}

#[test]
fn prompt_holds_observations_and_action() {
    let task = env_core::task("kessler/eco_station").unwrap();
    let scenario = Scenario::new(Recipe::new(task).unwrap(), Seed::user(1).unwrap());
    let mut episode = task.start(&scenario).unwrap();
    let time_step = |episode: &dyn env_core::task::Episode| TimeStep {
        observation: episode.telemetry(),
        reward: episode.last_reward(),
        done: episode.done(),
    };
    let before = time_step(&*episode);
    let mut log = ActionLog::new(2, Precision::F64);
    log.push_entry(1, &[0.25, 0.0]);
    log.end_step();
    episode.step(log.step(0), &mut StepReport::default()).unwrap();
    let after = time_step(&*episode);
    let step = JudgedStep {
        run: None,
        episode: "e",
        scenario: &scenario,
        log: &log,
        before: Some(&before),
        after: Some(&after),
    };
    insta::assert_snapshot!(format!(
        "{}\n\n=====\n\n{}",
        prompt::system(&step),
        prompt::user(&step, &before, &after)
    ));
}
