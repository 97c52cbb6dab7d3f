//! JSON values in the text of an answer, which may surround them with prose, code fences or reasoning.

use serde_json::Value;

/// Length limit of an answer, in bytes. Callers reject longer ones instead of parsing them.
pub const MAX_ANSWER_BYTES: usize = 256 * 1024;

/// Number of opening brackets at which parsing is tried. Bounds the cost of hostile text.
const MAX_PARSE_ATTEMPTS: usize = 256;

/// Returns the answer without a leading `<think>` block.
#[must_use]
pub fn strip_reasoning(text: &str) -> &str {
    text.rsplit_once("</think>").filter(|_| text.starts_with("<think>")).map_or(text, |(_, answer)| answer)
}

/// Iterates over the objects and arrays in a text, in order. Of an incomplete value, the complete values inside it are
/// returned.
pub fn json_values(text: &str) -> impl Iterator<Item = Value> {
    let mut position = 0;
    (0..MAX_PARSE_ATTEMPTS)
        .map_while(move |_| {
            let start = text[position..].find(['{', '[']).map(|offset| position + offset)?;
            let mut values = serde_json::Deserializer::from_str(&text[start..]).into_iter::<Value>();
            Some(match values.next() {
                Some(Ok(value)) => {
                    position = start + values.byte_offset();
                    Some(value)
                }
                _ => {
                    position = start + 1; // brackets are one byte
                    None
                }
            })
        })
        .flatten()
}
