//! Tokens: what whoever comes in shows. Only a hash of each is kept.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use rand::TryRng;
use secrecy::{ExposeSecret, SecretString};
use serde::Serialize;
use utoipa::ToSchema;

/// What was written where no token belongs, without those that stand in it.
#[must_use]
pub fn scrubbed(text: &str) -> Cow<'_, str> {
    let Some(at) = text.find(PREFIX) else { return text.into() };
    let (before, rest) = text.split_at(at + PREFIX.len());
    let of_token = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let after = rest.trim_start_matches(of_token);
    if rest.len() - after.len() < 2 * BYTES {
        return format!("{before}{}{}", &rest[..rest.len() - after.len()], scrubbed(after)).into();
    }
    format!("{before}…{}", scrubbed(after)).into()
}

/// What a token may do; each may do all that those before it may.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, ToSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Reads: runs, mastery, episodes, events, metrics.
    Viewer,
    /// Trains: creates runs, leases, reports, flies.
    Trainer,
    /// Steers: pauses runs, sets what they keep, asks designers, reads the audit log.
    Admin,
}

impl Role {
    /// As it is written.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Viewer => "viewer",
            Self::Trainer => "trainer",
            Self::Admin => "admin",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl FromStr for Role {
    type Err = ();

    fn from_str(word: &str) -> Result<Self, ()> {
        [Self::Viewer, Self::Trainer, Self::Admin].into_iter().find(|role| role.word() == word).ok_or(())
    }
}

/// What tokens begin with, so that programs that look for secrets know them.
const PREFIX: &str = "sparring_";
/// Random bytes of one.
const BYTES: usize = 32;

/// A token as it is shown: `sparring_<id>_<64 hexadecimal digits>`.
#[derive(Debug, Clone)]
pub struct Token {
    /// Its number in the database.
    pub id: i64,
    text: SecretString,
}

impl Token {
    /// A new one, from the operating system's randomness: 256 bits, so that its hash needs neither salt nor slowness.
    #[must_use]
    pub fn new(id: i64) -> Self {
        let mut bytes = [0u8; BYTES];
        rand::rngs::SysRng.try_fill_bytes(&mut bytes).expect("the operating system gives randomness");
        let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        Self { id, text: format!("{PREFIX}{id}_{digits}").into() }
    }

    /// What was shown, if it is a token at all.
    #[must_use]
    pub fn read(text: &str) -> Option<Self> {
        let (id, digits) = text.strip_prefix(PREFIX)?.split_once('_')?;
        let fine = digits.len() == 2 * BYTES && digits.bytes().all(|b| b.is_ascii_hexdigit());
        let id = id.parse().ok().filter(|id: &i64| *id > 0 && fine)?;
        Some(Self { id, text: text.into() })
    }

    /// What is kept of it; two are compared in constant time.
    #[must_use]
    pub fn hash(&self) -> blake3::Hash {
        blake3::hash(self.text.expose_secret().as_bytes())
    }

    /// The token itself: to be shown once, to who asked for it.
    #[must_use]
    pub fn show(&self) -> &str {
        self.text.expose_secret()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_reads_back_and_nothing_else_does() {
        let token = Token::new(7);
        let read = Token::read(token.show()).expect("it is one");
        assert_eq!((read.id, read.hash()), (7, token.hash()));
        assert_ne!(token.hash(), Token::new(7).hash());
        assert!(!format!("{token:?}").contains(token.show()));
        let digits = "0".repeat(64);
        for wrong in ["", "sparring_", "sparring_7_", "7_00", &digits] {
            assert!(Token::read(wrong).is_none(), "{wrong}");
        }
        for wrong in ["0", "-1", "x", "99999999999999999999"] {
            assert!(Token::read(&format!("sparring_{wrong}_{digits}")).is_none(), "{wrong}");
        }
        assert!(Token::read(&format!("sparring_1_{digits}0")).is_none());
    }

    #[test]
    fn a_token_is_taken_out_of_what_it_stands_in() {
        let token = Token::new(7);
        let token = token.show();
        assert_eq!(scrubbed("/v1/runs/sparring_demo/pause"), "/v1/runs/sparring_demo/pause");
        assert_eq!(scrubbed(&format!("/v1/runs/{token}/pause")), "/v1/runs/sparring_…/pause");
        assert_eq!(scrubbed(&format!("/sparring_x/{token}-{token}")), "/sparring_x/sparring_…-sparring_…");
    }

    proptest::proptest! {
        /// Whatever is shown is a token as it was written, or none.
        #[test]
        fn any_text_is_a_token_or_none(text in proptest::prop_oneof![".{0,100}", "sparring_[0-9-]{1,20}_[0-9a-f]{63,65}"]) {
            if let Some(token) = Token::read(&text) {
                proptest::prop_assert_eq!(token.show(), text.as_str());
            }
        }
    }
}
