//! Extraction of an action from a model's reply.

use llm::{LlmConfig, MAX_ANSWER_BYTES, json_values, strip_reasoning};
use serde_json::Value;

use super::action_codec::ActionCodec;

/// Returns the last action in a reply: models that think aloud write their final answer last.
///
/// # Errors
/// Returns the reason why there is no action, as half a sentence that the model can act on.
pub fn parse_action(text: &str, codec: &ActionCodec, config: &LlmConfig) -> Result<Value, String> {
    if text.len() > MAX_ANSWER_BYTES {
        return Err(format!("it has {} bytes, more than {MAX_ANSWER_BYTES}", text.len()));
    }
    let text = text.trim();
    if text.is_empty() {
        return Err("it is empty".to_owned());
    }
    let answer = strip_reasoning(text).trim();
    let mut values: Vec<Value> = json_values(answer).collect();
    // An empty list is an action if it is the whole answer, and only a pair of brackets elsewhere.
    values.retain(|value| answer == "[]" || value.as_array().is_none_or(|items| !items.is_empty()));
    let mut reason = None;
    for mut value in values.into_iter().rev() {
        // Some endpoints repeat the API key; decoding of escapes may have assembled it.
        config.redact_key_in(&mut value);
        match codec.extract(value) {
            Some(action) => return action,
            None => reason = Some(format!("the field {} is missing", codec.list_field())),
        }
    }
    Err(reason.unwrap_or_else(|| match serde_json::from_str::<Value>(answer) {
        Err(error) if answer.contains('{') => format!("it is not JSON ({error})"),
        _ => "it has no JSON object".to_owned(),
    }))
}
