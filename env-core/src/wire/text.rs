//! JSON as Python writes it.

use serde_json::Value;

/// Reads JSON, and what Python's `json` writes beside it: `NaN`, `Infinity`, `-Infinity` and numbers beyond the range of
/// a double. Those come out as strings of the same letters, which every reader of numbers here refuses by name
/// (`finite_number`), so that the fault names the field and not a column of the text. Linear in the text; nesting is
/// bounded as serde_json bounds it.
///
/// # Errors
/// What is not JSON either way.
pub fn read_json(text: &str) -> serde_json::Result<Value> {
    match serde_json::from_str(text) {
        Ok(value) => Ok(value),
        Err(error) => match quoted(text) {
            Some(text) => serde_json::from_str(&text),
            None => Err(error),
        },
    }
}

/// The text with strange numbers put into quotes; `None` if it has none.
fn quoted(text: &str) -> Option<String> {
    let bytes = text.as_bytes();
    let mut out = String::new();
    let (mut copied, mut at) = (0, 0);
    while at < bytes.len() {
        if bytes[at] == b'"' {
            at = after_string(bytes, at);
        } else if in_token(bytes[at]) {
            let start = at;
            while at < bytes.len() && in_token(bytes[at]) {
                at += 1;
            }
            if strange(&text[start..at]) {
                out.push_str(&text[copied..start]);
                out.extend(["\"", &text[start..at], "\""]);
                copied = at;
            }
        } else {
            at += 1;
        }
    }
    out.push_str(&text[copied..]);
    (copied > 0).then_some(out)
}

/// The place after the string that begins here, or the end of the text.
fn after_string(bytes: &[u8], quote: usize) -> usize {
    let mut at = quote + 1;
    while at < bytes.len() && bytes[at] != b'"' {
        at += if bytes[at] == b'\\' { 2 } else { 1 };
    }
    bytes.len().min(at + 1)
}

const fn in_token(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || matches!(byte, b'+' | b'-' | b'.')
}

/// What Python takes for a number and JSON has not.
fn strange(token: &str) -> bool {
    let digits = token.strip_prefix('-').unwrap_or(token);
    match digits {
        "NaN" => digits == token,
        "Infinity" => true,
        _ => {
            digits.starts_with(|c: char| c.is_ascii_digit())
                && token.parse::<f64>().is_ok_and(|v| v.is_infinite())
        }
    }
}
