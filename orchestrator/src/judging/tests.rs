//! What judges say, and what of a model's words counts.

use designer::llm::{LlmConfig, WallClock};
use env_core::log::Precision;
use env_core::task::StepReport;
use env_core::{ActionLog, Recipe, Scenario, Seed};

use super::*;
use crate::policy::Seen;

fn config() -> LlmConfig {
    let mut config = LlmConfig::new("http://127.0.0.1:1/v1", "m", WallClock::new(|| 0));
    config.key = Some("sk-secret".to_owned().into());
    config
}

fn read(text: &str) -> Result<Sentence, String> {
    model::read(text, &config())
}

/// The public kessler-env's formula at its ends: praise keeps the reward, blame takes a third of it.
#[test]
fn a_score_moves_the_reward_as_the_original_has_it() {
    for (score, share) in [(1.0, 1.0), (0.0, 1.0 / 1.2), (-1.0, 0.8 / 1.2)] {
        let word = Word { score, reasoning: String::new() };
        assert!((word.reward(0.6) - 0.6 * share).abs() < 1e-15);
    }
}

#[test]
fn an_alert_is_one_short_line() {
    let word = |reasoning: &str| Word { score: -0.5, reasoning: reasoning.to_owned() };
    assert_eq!(word("It burnt\n  for\tnothing.").alert(), "[JUDGE]: It burnt for nothing. (Score: -0.50)");
    let long = word(&"é".repeat(5000)).alert();
    assert!(long.chars().count() < 340 && long.ends_with("é… (Score: -0.50)"), "{long}");
}

#[test]
fn only_a_score_with_a_reason_is_a_verdict() {
    let good = read(r#"Well: {"score": 0.1} no, ```{"reasoning": " needed ", "score": 0.9}```"#).unwrap();
    assert_eq!((good.score, good.reasoning.as_str()), (0.9, "needed"));
    assert_eq!(read(r#"{"reasoning": "sk-secret", "score": -1}"#).unwrap().reasoning, "[key]");
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
fn words_for_who_judges() {
    for (word, judge) in [
        ("off", Judge::Off),
        ("", Judge::Off),
        ("False", Judge::Off),
        ("deterministic", Judge::Deterministic),
    ] {
        assert_eq!(Judge::parse(word), Ok(judge), "{word}");
    }
    assert_eq!([Judge::parse("true"), Judge::parse("1"), Judge::parse("LLM")], [const { Ok(Judge::Llm) }; 3]);
    assert!(Judge::parse("maybe").is_err());
    // Where no model is, the rules judge.
    let judges = Judges::new(Judge::Deterministic, None);
    assert_eq!(judges.meant(None), Judge::Deterministic);
    assert_eq!(judges.meant(Some(Judge::Off)), Judge::Off);
    assert_eq!(judges.meant(Some(Judge::Llm)), Judge::Deterministic);
}

/// What a judge is told of a step.
#[test]
fn a_judge_is_told_before_action_and_after() {
    let task = env_core::task("kessler/eco_station").unwrap();
    let scenario = Scenario::new(Recipe::new(task).unwrap(), Seed::user(1).unwrap());
    let mut episode = task.start(&scenario).unwrap();
    let look = |episode: &dyn env_core::task::Episode| Seen {
        observation: episode.telemetry(),
        reward: episode.last_reward(),
        done: episode.done(),
    };
    let before = look(&*episode);
    let mut log = ActionLog::new(2, Precision::F64);
    log.act(1, &[0.25, 0.0]);
    log.end_step();
    episode.step(log.step(0), &mut StepReport::default()).unwrap();
    let after = look(&*episode);
    let step = Step {
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
