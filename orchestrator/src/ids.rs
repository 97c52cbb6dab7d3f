//! Typed ids. An id that exists is well formed.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A run's id: 1 to 64 of `a-z 0-9 - _`.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(transparent)]
pub struct RunId(String);

/// A lease's id: its number, and a token so that a lease of another database is not taken for one of this.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct LeaseId {
    /// The number, in order of granting.
    pub number: i64,
    /// Six letters and digits.
    pub token: String,
}

/// An episode: a lease and an index, written `ep_<lease>_<index>`.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct EpisodeId {
    /// The lease.
    pub lease: LeaseId,
    /// Its index in the lease: group × group size + member.
    pub index: i64,
}

/// A layout, written `layout-<number>`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LayoutId(pub i64);

/// A round of asking a designer, written `ask-<number>`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct AskId(pub i64);

/// An evaluation, written `eval-<number>`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EvaluationId(pub i64);

/// An id that is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct BadId(&'static str);

impl RunId {
    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for RunId {
    type Err = BadId;

    fn from_str(text: &str) -> Result<Self, BadId> {
        let fine = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-' || c == '_';
        if (1..=64).contains(&text.len()) && text.chars().all(fine) {
            Ok(Self(text.to_owned()))
        } else {
            Err(BadId("a run's id is 1 to 64 of a-z, 0-9, - and _"))
        }
    }
}

impl fmt::Display for RunId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl<'de> Deserialize<'de> for RunId {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

const TOKEN: usize = 6;

impl FromStr for LeaseId {
    type Err = BadId;

    fn from_str(text: &str) -> Result<Self, BadId> {
        let bad = BadId("a lease's id is a number, a dash and six letters or digits, as 42-x7k2p9");
        let (number, token) = text.split_once('-').ok_or_else(|| bad.clone())?;
        // One lease, one name: not 042, not +42.
        let one_name = |n: &i64| *n > 0 && n.to_string() == number;
        let number = number.parse::<i64>().ok().filter(one_name).ok_or_else(|| bad.clone())?;
        let fine =
            token.len() == TOKEN && token.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit());
        if fine { Ok(Self { number, token: token.to_owned() }) } else { Err(bad) }
    }
}

impl fmt::Display for LeaseId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{}", self.number, self.token)
    }
}

impl FromStr for EpisodeId {
    type Err = BadId;

    fn from_str(text: &str) -> Result<Self, BadId> {
        let bad = BadId("an episode's id is ep_<lease>_<index>, as ep_42-x7k2p9_3");
        let (lease, index) =
            text.strip_prefix("ep_").and_then(|rest| rest.split_once('_')).ok_or_else(|| bad.clone())?;
        let index = index.parse::<i64>().ok().filter(|i| (0..1_000_000_000).contains(i));
        match (lease.parse(), index) {
            // One episode, one name: not 00, not +0.
            (Ok(lease), Some(index)) if text.ends_with(&format!("_{index}")) => Ok(Self { lease, index }),
            _ => Err(bad),
        }
    }
}

impl fmt::Display for EpisodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ep_{}_{}", self.lease, self.index)
    }
}

/// A number after a word and a dash: above 0, written one way.
fn numbered(text: &str, word: &str) -> Option<i64> {
    let digits = text.strip_prefix(word)?.strip_prefix('-')?;
    digits.parse::<i64>().ok().filter(|number| *number > 0 && number.to_string() == digits)
}

impl FromStr for LayoutId {
    type Err = BadId;

    fn from_str(text: &str) -> Result<Self, BadId> {
        numbered(text, "layout").map(Self).ok_or(BadId("a layout's id is layout- and a number, as layout-7"))
    }
}

impl fmt::Display for LayoutId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "layout-{}", self.0)
    }
}

impl FromStr for AskId {
    type Err = BadId;

    fn from_str(text: &str) -> Result<Self, BadId> {
        numbered(text, "ask").map(Self).ok_or(BadId("an ask's id is ask- and a number, as ask-7"))
    }
}

impl fmt::Display for AskId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ask-{}", self.0)
    }
}

impl FromStr for EvaluationId {
    type Err = BadId;

    fn from_str(text: &str) -> Result<Self, BadId> {
        numbered(text, "eval").map(Self).ok_or(BadId("an evaluation's id is eval- and a number, as eval-7"))
    }
}

impl fmt::Display for EvaluationId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "eval-{}", self.0)
    }
}

/// `count` letters and digits from the operating system's randomness.
#[must_use]
pub fn random_token(count: usize) -> String {
    const LETTERS: &[u8; 32] = b"abcdefghijkmnpqrstuvwxyz23456789";
    let bytes = entropy();
    bytes.iter().cycle().take(count.min(16)).map(|b| char::from(LETTERS[usize::from(b % 32)])).collect()
}

/// A run's seed, of those that people may choose (below 2⁵¹), from the operating system's randomness.
#[must_use]
pub fn random_seed() -> u64 {
    let bytes = entropy();
    bytes.iter().take(8).fold(0u64, |seed, &b| (seed << 8) | u64::from(b)) >> 13
}

/// The one place where ambient randomness enters: names and seeds of new things, never what follows from them.
fn entropy() -> [u8; 16] {
    let mut bytes = [0; 16];
    rand::TryRng::try_fill_bytes(&mut rand::rngs::SysRng, &mut bytes)
        .expect("an operating system without randomness cannot name anything: nothing could go on");
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_read_back_and_refuse_what_is_none() {
        let episode: EpisodeId = "ep_42-x7k2p9_3".parse().unwrap();
        assert_eq!((episode.lease.number, episode.index), (42, 3));
        assert_eq!(episode.to_string(), "ep_42-x7k2p9_3");
        for bad in [
            "",
            "ep_",
            "ep_1_2",
            "ep_42-x7k2p9_-1",
            "ep_42-x7k2p9_00",
            "ep_42-x7k2p9_+0",
            "ep_42-X7K2P9_1",
            "ep_42-x7k2p9_99999999999999999999",
        ] {
            assert!(bad.parse::<EpisodeId>().is_err(), "{bad}");
        }
        for bad in ["", "A", "a b", "../x", &"x".repeat(65)] {
            assert!(bad.parse::<RunId>().is_err(), "{bad}");
        }
        assert_eq!("layout-7".parse(), Ok(LayoutId(7)));
        assert_eq!(AskId(12).to_string().parse(), Ok(AskId(12)));
        for bad in ["", "layout", "layout-", "layout-0", "layout-07", "layout--7", "layout-+7", "ask-7", "7"]
        {
            assert!(bad.parse::<LayoutId>().is_err(), "{bad}");
        }
        assert_eq!(random_token(6).len(), 6);
        assert!(random_seed() < 1 << 53);
    }

    proptest::proptest! {
        /// Whatever comes is read or refused, and what is read is written as it came: one thing has one name.
        #[test]
        fn any_text_is_an_id_or_none(text in proptest::prop_oneof![
            ".{0,40}",
            "(ep_)?[0-9]{1,20}-[a-z0-9]{5,7}(_[0-9]{1,12})?",
            "(layout|ask)-[0-9+-]{1,20}",
            "[a-z0-9_-]{0,70}",
        ]) {
            let told = [
                text.parse::<RunId>().map(|id| id.to_string()),
                text.parse::<LeaseId>().map(|id| id.to_string()),
                text.parse::<EpisodeId>().map(|id| id.to_string()),
                text.parse::<LayoutId>().map(|id| id.to_string()),
                text.parse::<AskId>().map(|id| id.to_string()),
            ];
            for told in told.into_iter().flatten() {
                proptest::prop_assert_eq!(&told, &text);
            }
        }
    }
}
