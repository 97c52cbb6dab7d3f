//! Untrusted text (names and words of a model or a file) that is safe to show in a terminal.

/// Length limit of [`shorten`], in characters.
const MAX_CHARS: usize = 60;
/// Length limit of an identifier such as a failure mode, in characters.
const MAX_IDENTIFIER_CHARS: usize = 40;

/// Returns true if a character moves the cursor or changes the direction of text.
pub(crate) fn is_control(c: char) -> bool {
    c.is_control() || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Returns at most 60 characters of a text for a message, as one line without control characters.
pub(crate) fn shorten(text: &str) -> String {
    let text: String = text.chars().map(|c| if is_control(c) { ' ' } else { c }).collect();
    if text.chars().count() <= MAX_CHARS {
        text
    } else {
        text.chars().take(MAX_CHARS - 3).chain("...".chars()).collect()
    }
}

/// Returns an identifier that came from a file: its letters, digits and `_`.
pub(crate) fn identifier(text: &str) -> String {
    text.chars().filter(|c| c.is_ascii_alphanumeric() || *c == '_').take(MAX_IDENTIFIER_CHARS).collect()
}
