//! Numbers that are not finite in JSON text: those beyond the range of a double, and the words that Python writes for them.

use std::ops::Range;

use serde::de::IgnoredAny;

use super::json_content::JsonContent;
use super::json_tokens::{JsonToken, JsonTokens};

/// Number in a JSON text that is not finite.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NonFiniteLiteral {
    /// Range of its bytes in the text.
    pub range: Range<usize>,
    /// Its letters and digits.
    pub text: String,
    /// Place among all values of the text in their order, from 1. A list or object comes before its content.
    pub(super) value: usize,
}

/// Finds `NaN`, `Infinity`, `-Infinity` and the numbers beyond the range of a double, such as `1e999`, in the order of the
/// text. Python's `json` reads and writes all of them as numbers.
pub fn non_finite_literals(text: &[u8]) -> impl Iterator<Item = NonFiniteLiteral> {
    let mut content = JsonContent::default();
    JsonTokens::new(text).filter_map(move |token| {
        content.add(&token);
        let JsonToken::Literal(range) = token else { return None };
        // Before a colon it would be a key, which is malformed.
        if text[range.end..].iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b':') {
            return None;
        }
        let literal = str::from_utf8(&text[range.clone()]).ok().filter(|literal| is_not_finite(literal))?;
        Some(NonFiniteLiteral { range, text: literal.to_owned(), value: content.values() })
    })
}

/// JSON text with a string in place of each number that is not finite. All other bytes keep their places.
#[derive(Debug)]
pub struct BlankedText {
    /// The text with empty strings.
    pub text: Vec<u8>,
    /// The replaced numbers in their order.
    pub literals: Vec<NonFiniteLiteral>,
}

impl BlankedText {
    /// Replaces the numbers of a text that are not finite. Returns `None` if it has none, or more than `max`.
    #[must_use]
    pub fn new(text: &[u8], max: usize) -> Option<Self> {
        let literals: Vec<NonFiniteLiteral> = non_finite_literals(text).take(max + 1).collect();
        if literals.is_empty() || literals.len() > max {
            return None;
        }
        let mut text = text.to_vec();
        for literal in &literals {
            // The shortest of these numbers has three bytes.
            text[literal.range.clone()].fill(b' ');
            text[literal.range.start..][..2].fill(b'"');
        }
        Some(Self { text, literals })
    }
}

/// Returns true for a number of Python that is not finite.
fn is_not_finite(literal: &str) -> bool {
    match literal {
        "NaN" | "Infinity" | "-Infinity" => true,
        // `f64` parses forms that are not JSON, such as `inf` and `+1e999`.
        _ => {
            literal.ends_with(|last: char| last.is_ascii_digit())
                && literal.parse().is_ok_and(f64::is_infinite)
                && serde_json::from_str::<IgnoredAny>(literal).is_ok()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(text: &str) -> Vec<(&str, usize)> {
        non_finite_literals(text.as_bytes()).map(|found| (&text[found.range], found.value)).collect()
    }

    #[test]
    fn numbers_are_found_with_their_places_among_the_values() {
        assert_eq!(found("NaN"), [("NaN", 1)]);
        assert_eq!(found(r#"{"NaN": ["1e999", 1e999, [-Infinity]]}"#), [("1e999", 4), ("-Infinity", 6)]);
        let digits = "9".repeat(400);
        assert_eq!(found(&format!("[0,{digits}]")), [(&*digits, 3)]);
    }

    #[test]
    fn finite_numbers_and_malformed_text_are_not_found() {
        for text in [
            "1e308",
            "-0",
            "inf",
            "nan",
            "-NaN",
            "+1e999",
            "01e999",
            ".5e999",
            "1.e999",
            "1e999x",
            "\"1e999",
            "{NaN : 1}",
            "{1e999:\"x\"}",
        ] {
            assert!(found(text).is_empty(), "{text}");
        }
    }

    #[test]
    fn blanked_text_keeps_the_places_of_its_other_bytes() {
        let blanked = BlankedText::new(br#"[NaN,"a", -1e999]"#, 2).expect("two numbers");
        assert_eq!(blanked.text, br#"["" ,"a", ""    ]"#);
        assert_eq!(blanked.literals.len(), 2);
        assert!(BlankedText::new(b"[NaN,NaN]", 1).is_none());
        assert!(BlankedText::new(b"[1]", 1).is_none());
    }
}
