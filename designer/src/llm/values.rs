//! JSON out of whatever a model said: as asked for, or somewhere within prose, fences and half-finished lists.

use serde_json::Value;

/// Bytes of an answer that are looked at, at most.
pub const MAX_TEXT: usize = 256 * 1024;
/// Places where a JSON value is looked for, at most, so that hostile text costs little.
const MAX_STARTS: usize = 256;

/// What a model means, without what it thought aloud before.
#[must_use]
pub fn meant(text: &str) -> &str {
    text.rsplit_once("</think>").filter(|_| text.starts_with("<think>")).map_or(text, |(_, meant)| meant)
}

/// The objects and lists within a text, in order; of what is not whole, the whole ones within it.
pub fn values(text: &str) -> impl Iterator<Item = Value> {
    let mut at = 0;
    (0..MAX_STARTS)
        .map_while(move |_| {
            let start = text[at..].find(['{', '[']).map(|offset| at + offset)?;
            let mut values = serde_json::Deserializer::from_str(&text[start..]).into_iter::<Value>();
            Some(match values.next() {
                Some(Ok(value)) => {
                    at = start + values.byte_offset();
                    Some(value)
                }
                _ => {
                    at = start + 1; // brackets are one byte
                    None
                }
            })
        })
        .flatten()
}
