//! Counts the values and keys of JSON text before a parser allocates memory for them.

use super::input_error::{ContentKind, InputError, InputLimits};
use super::json_tokens::{JsonToken, JsonTokens};

/// Content of a JSON text. It is exact for valid JSON; invalid text is left to the parser.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct JsonContent {
    /// Number of values and keys.
    tokens: usize,
    keys: usize,
}

impl JsonContent {
    /// Counts the content of a text in one pass, without memory.
    #[must_use]
    pub fn count(text: &[u8]) -> Self {
        let mut content = Self::default();
        for token in JsonTokens::new(text) {
            content.add(&token);
        }
        content
    }

    /// Counts one more token.
    pub(super) const fn add(&mut self, token: &JsonToken) {
        match token {
            JsonToken::Colon => self.keys += 1,
            JsonToken::Container | JsonToken::Text | JsonToken::Literal(_) => self.tokens += 1,
        }
    }

    /// Returns the number of values. Within a text, that of the values so far if the last token is no key.
    pub(super) const fn values(self) -> usize {
        self.tokens.saturating_sub(self.keys)
    }

    /// Checks the content of a text against limits. Only a text that is long enough to exceed one is read.
    ///
    /// # Errors
    /// Returns [`InputError::TooLarge`] if the content exceeds a limit.
    pub fn check_text(text: &[u8], limits: InputLimits) -> Result<(), InputError> {
        // A value takes a byte and one to separate it from the next; a key takes two quotes, a colon and its value.
        let may_exceed = text.len().div_ceil(2) > limits.values || text.len() / 4 > limits.keys;
        if may_exceed { Self::count(text).check(limits) } else { Ok(()) }
    }

    /// Checks the content against limits.
    ///
    /// # Errors
    /// Returns [`InputError::TooLarge`] if the content exceeds a limit.
    pub fn check(self, limits: InputLimits) -> Result<(), InputError> {
        if self.keys > limits.keys {
            return Err(limits.error(ContentKind::Keys));
        }
        if self.values() > limits.values { Err(limits.error(ContentKind::Values)) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::Value;

    use super::*;
    use crate::tests::any_json;

    fn count(value: &Value) -> JsonContent {
        let mut content = JsonContent { tokens: 1, keys: 0 };
        let mut add = |inner: &Value, keys: usize| {
            let inner = count(inner);
            content.tokens += inner.tokens + keys;
            content.keys += inner.keys + keys;
        };
        match value {
            Value::Array(items) => items.iter().for_each(|item| add(item, 0)),
            Value::Object(fields) => fields.values().for_each(|value| add(value, 1)),
            _ => {}
        }
        content
    }

    proptest! {
        #[test]
        fn content_is_counted_exactly(value in any_json()) {
            prop_assert_eq!(JsonContent::count(value.to_string().as_bytes()), count(&value));
        }

        #[test]
        fn short_texts_are_checked_exactly(value in any_json(), values in 0..20_usize, keys in 0..10_usize) {
            let (text, limits) = (value.to_string(), InputLimits { values, keys });
            let exact = count(&value).check(limits).is_ok();
            prop_assert_eq!(JsonContent::check_text(text.as_bytes(), limits).is_ok(), exact);
        }

        #[test]
        fn arbitrary_text_never_panics(text: Vec<u8>) {
            let _ = JsonContent::count(&text);
        }
    }
}
