//! Tokens of JSON text.

use std::ops::Range;

/// Token of a JSON text that counts as a value or marks a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum JsonToken {
    /// Beginning of an object or a list.
    Container,
    /// String; a key if a colon follows.
    Text,
    /// Separator between a key and its value.
    Colon,
    /// Number, `true`, `false` or `null`, or other letters and digits in invalid text; the range of its bytes.
    Literal(Range<usize>),
}

/// Iterator over the tokens of a text. It is exact for valid JSON; invalid text is left to the parser.
#[derive(Debug)]
pub(super) struct JsonTokens<'a> {
    text: &'a [u8],
    at: usize,
}

impl<'a> JsonTokens<'a> {
    pub(super) const fn new(text: &'a [u8]) -> Self {
        Self { text, at: 0 }
    }
}

impl Iterator for JsonTokens<'_> {
    type Item = JsonToken;

    fn next(&mut self) -> Option<JsonToken> {
        loop {
            let start = self.at;
            let byte = *self.text.get(start)?;
            self.at += 1;
            match byte {
                b'"' => {
                    self.at = end_of_string(self.text, start);
                    return Some(JsonToken::Text);
                }
                b'{' | b'[' => return Some(JsonToken::Container),
                b':' => return Some(JsonToken::Colon),
                _ if is_literal(byte) => {
                    while self.text.get(self.at).is_some_and(|byte| is_literal(*byte)) {
                        self.at += 1;
                    }
                    return Some(JsonToken::Literal(start..self.at));
                }
                _ => {}
            }
        }
    }
}

/// Returns the offset after the JSON string that begins at `quote`, or the end of the text if it is unterminated.
fn end_of_string(text: &[u8], quote: usize) -> usize {
    let mut at = quote + 1;
    while at < text.len() && text[at] != b'"' {
        at += if text[at] == b'\\' { 2 } else { 1 };
    }
    text.len().min(at + 1)
}

/// Returns true for the bytes of numbers, `true`, `false` and `null`.
const fn is_literal(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'+' | b'.')
}
