//! Access tokens as clients send them. The server stores only a hash of each token.

use std::borrow::Cow;

use rand::TryRng;
use secrecy::{ExposeSecret, SecretString};

/// First characters of a token, by which programs that search for secrets recognise it.
const PREFIX: &str = "sparring_";
/// Random bytes of a token.
const RANDOM_BYTES: usize = 32;

/// An access token: `sparring_<id>_<64 hexadecimal digits>`.
#[derive(Debug, Clone)]
pub struct Token {
    /// Number of the token in the database.
    pub id: i64,
    text: SecretString,
}

impl Token {
    /// Creates a token from 256 random bits of the operating system. So many need neither a salt nor a slow hash.
    #[must_use]
    pub fn new(id: i64) -> Self {
        let mut bytes = [0u8; RANDOM_BYTES];
        rand::rngs::SysRng.try_fill_bytes(&mut bytes).expect("the operating system provides randomness");
        let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        Self { id, text: format!("{PREFIX}{id}_{digits}").into() }
    }

    /// Creates a token that no database has, for the requests of one process to its own service.
    #[must_use]
    pub fn for_process() -> Self {
        Self::new(i64::MAX)
    }

    /// Parses a token; none if the text is not one.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let (id, digits) = text.strip_prefix(PREFIX)?.split_once('_')?;
        let is_valid = digits.len() == 2 * RANDOM_BYTES && digits.bytes().all(|b| b.is_ascii_hexdigit());
        // A token has one text: neither 07 nor +7 is a number of a token. [`redact`] knows this text only.
        let is_canonical = |number: &i64| *number > 0 && number.to_string() == id;
        let id = id.parse().ok().filter(|number| is_valid && is_canonical(number))?;
        Some(Self { id, text: text.into() })
    }

    /// The hash that is stored. Hashes are compared in constant time.
    #[must_use]
    pub fn hash(&self) -> blake3::Hash {
        blake3::hash(self.text.expose_secret().as_bytes())
    }

    /// The text of the token, to be shown once to the user who created it.
    #[must_use]
    pub fn expose(&self) -> &str {
        self.text.expose_secret()
    }
}

/// Replaces tokens in a text that will be logged or stored by `sparring_…`.
#[must_use]
pub fn redact(text: &str) -> Cow<'_, str> {
    let Some(at) = text.find(PREFIX) else { return text.into() };
    let (before, rest) = text.split_at(at + PREFIX.len());
    let is_token_char = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let after = rest.trim_start_matches(is_token_char);
    if rest.len() - after.len() < 2 * RANDOM_BYTES {
        return format!("{before}{}{}", &rest[..rest.len() - after.len()], redact(after)).into();
    }
    format!("{before}…{}", redact(after)).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_valid_tokens_parse() {
        let token = Token::new(7);
        let parsed = Token::parse(token.expose()).expect("the text is a token");
        assert_eq!((parsed.id, parsed.hash()), (7, token.hash()));
        assert_ne!(token.hash(), Token::new(7).hash());
        assert!(!format!("{token:?}").contains(token.expose()));
        let digits = "0".repeat(64);
        for wrong in ["", "sparring_", "sparring_7_", "7_00", &digits] {
            assert!(Token::parse(wrong).is_none(), "{wrong}");
        }
        for wrong in ["0", "-1", "+1", "01", "x", "99999999999999999999"] {
            assert!(Token::parse(&format!("sparring_{wrong}_{digits}")).is_none(), "{wrong}");
        }
        assert!(Token::parse(&format!("sparring_1_{digits}0")).is_none());
    }

    #[test]
    fn tokens_are_redacted_and_other_words_stay() {
        let token = Token::new(7);
        let token = token.expose();
        assert_eq!(redact("/v1/runs/sparring_demo/pause"), "/v1/runs/sparring_demo/pause");
        assert_eq!(redact(&format!("/v1/runs/{token}/pause")), "/v1/runs/sparring_…/pause");
        assert_eq!(redact(&format!("/sparring_x/{token}-{token}")), "/sparring_x/sparring_…-sparring_…");
    }

    proptest::proptest! {
        #[test]
        fn parsed_token_has_the_same_text(text in proptest::prop_oneof![".{0,100}", "sparring_[0-9-]{1,20}_[0-9a-f]{63,65}"]) {
            if let Some(token) = Token::parse(&text) {
                proptest::prop_assert_eq!(token.expose(), text.as_str());
            }
        }
    }
}
