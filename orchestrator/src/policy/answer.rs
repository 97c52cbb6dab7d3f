//! An action out of whatever a model said.

use designer::llm::{LlmConfig, MAX_TEXT, meant, values};
use serde_json::Value;

use super::actions::Actions;

/// The action of an answer: the last one there is, since models that think aloud say what they mean last.
///
/// # Errors
/// Why there is none, in half a sentence that the model can act on.
pub(super) fn read(text: &str, actions: &Actions, config: &LlmConfig) -> Result<Value, String> {
    if text.len() > MAX_TEXT {
        return Err(format!("it is {} bytes long", text.len()));
    }
    let text = text.trim();
    if text.is_empty() {
        return Err("it is empty".to_owned());
    }
    let meant = meant(text).trim();
    let mut found: Vec<Value> = values(meant).collect();
    // A list without entries is an action where it is all that is said, and a bracket elsewhere.
    found.retain(|value| meant == "[]" || value.as_array().is_none_or(|items| !items.is_empty()));
    let mut reason = None;
    for mut value in found.into_iter().rev() {
        // Some endpoints repeat our key; decoding may have put it together.
        config.scrub_value(&mut value);
        match actions.meant(value) {
            Some(action) => return action,
            None => reason = Some(format!("{} is missing", actions.list())),
        }
    }
    Err(reason.unwrap_or_else(|| match serde_json::from_str::<Value>(meant) {
        Err(error) if meant.contains('{') => format!("it is no JSON ({error})"),
        _ => "it holds no JSON object".to_owned(),
    }))
}
