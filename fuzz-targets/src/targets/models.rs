//! Answers of language models and of their endpoints: chat completions, pauses, actions and verdicts.

use std::sync::LazyLock;
use std::time::Duration;

use env_core::log::{ActionLog, Precision};
use llm::fuzzing::{decode_response, parse_retry_after};
use llm::{LlmConfig, WallClock, json_values, sanitize_line, strip_reasoning};
use llm_policy::ActionCodec;
use llm_policy::fuzzing::{parse_action, parse_verdict};
use openenv_wire::wire_format;
use serde_json::{Value, json};

use crate::target::{Target, json_seeds, seeds_of, with_text};

pub(super) const TARGETS: &[Target] = &[
    Target::new("chat_response", chat_response, response_seeds),
    Target::new("retry_after", retry_after, retry_seeds),
    Target::new("json_in_text", json_in_text, text_seeds),
    Target::new("reply", reply, reply_seeds),
    Target::new("verdict", verdict, verdict_seeds),
];

/// Time of the tests, in milliseconds since 1970 UTC.
const NOW_MS: i64 = 1_700_000_000_000;

fn config() -> &'static LlmConfig {
    static CONFIG: LazyLock<LlmConfig> = LazyLock::new(|| {
        let mut config = LlmConfig::new("http://127.0.0.1:1/v1", "m", WallClock::new(|| NOW_MS));
        config.key = Some("sk-secret".to_owned().into());
        config
    });
    &CONFIG
}

/// Token arrays of a completion are complete: as long as in the body.
fn chat_response(bytes: &[u8]) -> bool {
    let body = String::from_utf8_lossy(bytes);
    let Ok(response) = decode_response(&body) else { return false };
    let value: Value = serde_json::from_str(&body).expect("a completion is JSON");
    if let Some(details) = response.token_details {
        let length = |pointer: &str| value.pointer(pointer).and_then(Value::as_array).map(Vec::len);
        if let Some(prompt) = details.prompt {
            assert_eq!(Some(prompt.len()), length("/prompt_token_ids"));
        }
        if let Some(logprobs) = details.logprobs {
            assert_eq!(Some(logprobs.len()), length("/choices/0/logprobs/content"));
            assert!(logprobs.iter().all(|logprob| logprob.is_finite()));
        }
    }
    true
}

/// A pause in seconds is the number of the header.
fn retry_after(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let Some(pause) = parse_retry_after(text, NOW_MS) else { return false };
        if let Ok(seconds) = text.trim().parse::<u32>() {
            assert_eq!(pause, Duration::from_secs(seconds.into()));
        }
        true
    })
}

/// Values in a text are objects or lists. Sanitised text has no control characters.
fn json_in_text(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        assert!(text.ends_with(strip_reasoning(text)), "the answer is not the end of the text");
        let line = sanitize_line(text);
        assert!(!line.chars().any(char::is_control), "{line:?} has a control character");
        let values: Vec<Value> = json_values(text).collect();
        assert!(values.iter().all(|value| value.is_object() || value.is_array()));
        !values.is_empty()
    })
}

/// An action of a reply is valid for the task's wire format, and has no key of the endpoint.
fn reply(bytes: &[u8]) -> bool {
    static CODECS: LazyLock<Vec<ActionCodec>> = LazyLock::new(|| {
        env_core::worlds().filter_map(|world| world.tasks().first().copied()).map(ActionCodec::new).collect()
    });
    with_text(bytes, |text| {
        let reads = |codec: &&ActionCodec| match parse_action(text, codec, config()) {
            Ok(action) => {
                let mut log = ActionLog::new(codec.task().action_space().dim(), Precision::F64);
                wire_format(codec.task()).read_action(&action, &mut log).expect("the action is valid");
                assert!(!action.to_string().contains("sk-secret"), "the action has the key");
                true
            }
            Err(reason) => {
                assert!(!reason.is_empty());
                false
            }
        };
        CODECS.iter().filter(reads).count() > 0
    })
}

/// A verdict has a score from −1 to 1 and a reason without control characters or the key of the endpoint.
fn verdict(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let Ok(verdict) = parse_verdict(text, config()) else { return false };
        assert!((-1.0..=1.0).contains(&verdict.score), "{}", verdict.score);
        assert!(!verdict.reasoning.is_empty() && !verdict.reasoning.contains("sk-secret"));
        assert!(!verdict.reasoning.chars().any(|c| c.is_control() && c != '\n'), "{:?}", verdict.reasoning);
        true
    })
}

fn response_seeds() -> Vec<Vec<u8>> {
    json_seeds([
        json!({"choices": [{"message": {"content": "{\"burns\": []}", "refusal": null}, "finish_reason": "stop",
                "token_ids": [7, 8], "logprobs": {"content": [{"logprob": -0.5}, {"logprob": 0}]}}],
            "prompt_token_ids": [1, 2, 3], "usage": {"prompt_tokens": 12, "completion_tokens": 3.0}}),
        json!({"choices": [{"message": {"content": [{"type": "text", "text": "a"}, {"text": "b"}]}}], "error": null}),
        json!({"choices": [{"message": {"content": null}, "finish_reason": "length"}]}),
    ])
}

fn retry_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "3",
        "1.5",
        "0",
        "Wed, 21 Oct 2026 07:28:00 GMT",
        "Sunday, 06-Nov-94 08:49:37 GMT",
        "Sun Nov  6 08:49:37 1994",
    ])
}

fn text_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "<think>a {</think>It is {\"a\": [1, 2]} and [3]",
        "```json\n{\"b\": \"\\u00e9}\"}\n``` {",
        "[[[{}]]]",
    ])
}

fn reply_seeds() -> Vec<Vec<u8>> {
    let burn = r#"{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": -0.2}"#;
    let mut seeds = seeds_of(&[
        "[]",
        "<think>{}</think>I choose {\"action\": {\"burns\": []}} now",
        "{\"burns\": [{\"satellite_id\": 1, \"delta_vx\": 9, \"delta_vy\": 0, \"why\": \"sk-\\u0073ecret\"}]} or {\"x\": 1}",
    ]);
    seeds.extend(
        [format!("```json\n{{\"burns\": [{burn}]}}\n```"), format!("[{burn}, {burn}]")]
            .map(String::into_bytes),
    );
    seeds
}

fn verdict_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        r#"{"score": 0.5, "reasoning": "The burn avoids the debris.\nIt is small."}"#,
        "Let me think. {\"score\": -1, \"reasoning\": \"sk-\\u0073ecret \\u001b[31m\"} Done.",
        r#"[{"score": 0}] {"score": 1, "reasoning": "x"}"#,
    ])
}
