//! Typed ids. A value of an id type is always well formed.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::shard::{Shard, split_id, write_id};

/// Id of a run: 1 to 64 of `a-z 0-9 - _`, after the shard of its server and a dot if the server has one.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(transparent)]
pub struct RunId(String);

/// Id of a lease, written `<number>-<suffix>`. The suffix keeps leases of different databases apart.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct LeaseId {
    /// Number of the lease, from 1, in order of granting.
    pub number: i64,
    /// Six letters and digits.
    pub suffix: String,
}

/// Id of an episode, written `ep_<lease>_<index>`.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct EpisodeId {
    /// Id of the lease.
    pub lease: LeaseId,
    /// Index of the episode in the lease: group × group size + member.
    pub index: i64,
}

/// Id of a designed layout, written `layout-<number>`, after the shard of its run.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LayoutId {
    /// Shard of the run; none if the id of the run has none.
    pub shard: Option<Shard>,
    /// Number of the layout in its database, from 1.
    pub number: i64,
}

/// Id of a design request, written `ask-<number>`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct DesignRequestId(pub i64);

/// Id of an evaluation, written `eval-<number>`, after the shard of its server.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EvaluationId {
    /// Shard of the server; none if the server has none.
    pub shard: Option<Shard>,
    /// Number of the evaluation in its database, from 1.
    pub number: i64,
}

/// A text that is not an id.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{rule}, got {text:?}")]
pub struct InvalidId {
    /// The rule that the text breaks.
    rule: &'static str,
    /// The beginning of the text.
    text: String,
}

impl InvalidId {
    /// Largest number of characters of the text that the error shows.
    const MAX_SHOWN_CHARS: usize = 80;

    fn new(rule: &'static str, text: &str) -> Self {
        Self { rule, text: text.chars().take(Self::MAX_SHOWN_CHARS).collect() }
    }
}

impl RunId {
    /// The id as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Returns the shard of the run; `None` if its server had none when the run was created.
    #[must_use]
    pub fn shard(&self) -> Option<Shard> {
        Shard::of_id(&self.0)
    }

    /// Returns a generated id: `run-` and random characters, after a shard.
    #[must_use]
    pub fn generate(shard: Option<&Shard>) -> Self {
        let name = format!("run-{}", random_token(GENERATED_ID_CHARS));
        Self(shard.map_or(name.clone(), |shard| format!("{shard}.{name}")))
    }
}

/// Random characters of a generated run id after `run-`.
const GENERATED_ID_CHARS: usize = 8;

impl FromStr for RunId {
    type Err = InvalidId;

    fn from_str(text: &str) -> Result<Self, InvalidId> {
        let is_valid = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-' || c == '_';
        let parts = split_id(text);
        let has_valid_shard = parts.shard.is_none_or(|shard| shard.parse::<Shard>().is_ok());
        if has_valid_shard && (1..=64).contains(&parts.name.len()) && parts.name.chars().all(is_valid) {
            Ok(Self(text.to_owned()))
        } else {
            Err(InvalidId::new("must be 1 to 64 characters of a-z, 0-9, - and _", text))
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

/// Characters of the suffix of a lease id.
const LEASE_SUFFIX_CHARS: usize = 6;

impl FromStr for LeaseId {
    type Err = InvalidId;

    fn from_str(text: &str) -> Result<Self, InvalidId> {
        let invalid = || InvalidId::new("must be the id of a lease, such as 42-x7k2p9", text);
        let (number, suffix) = text.split_once('-').ok_or_else(invalid)?;
        // A lease has one id: neither 042 nor +42 is a number of a lease.
        let is_canonical = |n: &i64| *n > 0 && n.to_string() == number;
        let number = number.parse::<i64>().ok().filter(is_canonical).ok_or_else(invalid)?;
        let is_valid = suffix.len() == LEASE_SUFFIX_CHARS
            && suffix.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit());
        if is_valid { Ok(Self { number, suffix: suffix.to_owned() }) } else { Err(invalid()) }
    }
}

impl fmt::Display for LeaseId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{}", self.number, self.suffix)
    }
}

impl FromStr for EpisodeId {
    type Err = InvalidId;

    fn from_str(text: &str) -> Result<Self, InvalidId> {
        let invalid = || InvalidId::new("must be the id of an episode, such as ep_42-x7k2p9_3", text);
        let (lease, index) =
            text.strip_prefix("ep_").and_then(|rest| rest.split_once('_')).ok_or_else(invalid)?;
        let index = index.parse::<i64>().ok().filter(|i| (0..1_000_000_000).contains(i));
        match (lease.parse(), index) {
            // An episode has one id: neither 00 nor +0 is an index.
            (Ok(lease), Some(index)) if text.ends_with(&format!("_{index}")) => Ok(Self { lease, index }),
            _ => Err(invalid()),
        }
    }
}

impl fmt::Display for EpisodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ep_{}_{}", self.lease, self.index)
    }
}

/// Parses `<word>-<number>`. The number is positive and has no other notation.
fn parse_numbered(text: &str, word: &str) -> Option<i64> {
    let digits = text.strip_prefix(word)?.strip_prefix('-')?;
    digits.parse::<i64>().ok().filter(|number| *number > 0 && number.to_string() == digits)
}

/// Number with the shard that it is written after.
struct ShardedNumber {
    shard: Option<Shard>,
    number: i64,
}

/// Parses `<shard>.<word>-<number>`, or the same without a shard.
fn parse_sharded(text: &str, word: &str) -> Option<ShardedNumber> {
    let parts = split_id(text);
    let shard = match parts.shard {
        Some(shard) => Some(shard.parse().ok()?),
        None => None,
    };
    Some(ShardedNumber { shard, number: parse_numbered(parts.name, word)? })
}

impl LayoutId {
    /// Returns the id of a layout of a run, whose shard it has.
    #[must_use]
    pub fn of_run(run: &str, number: i64) -> Self {
        Self { shard: Shard::of_id(run), number }
    }

    /// Returns true if the id can be that of a layout of this run: it has the same shard, or none.
    #[must_use]
    pub fn may_be_of(&self, run: &RunId) -> bool {
        self.shard.is_none() || self.shard == run.shard()
    }
}

impl FromStr for LayoutId {
    type Err = InvalidId;

    fn from_str(text: &str) -> Result<Self, InvalidId> {
        let invalid = || InvalidId::new("must be the id of a layout, such as layout-7", text);
        let ShardedNumber { shard, number } = parse_sharded(text, "layout").ok_or_else(invalid)?;
        Ok(Self { shard, number })
    }
}

impl fmt::Display for LayoutId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_id(f, self.shard.as_ref(), format_args!("layout-{}", self.number))
    }
}

impl FromStr for DesignRequestId {
    type Err = InvalidId;

    fn from_str(text: &str) -> Result<Self, InvalidId> {
        let number = parse_numbered(text, "ask");
        number
            .map(Self)
            .ok_or_else(|| InvalidId::new("must be the id of a design request, such as ask-7", text))
    }
}

impl fmt::Display for DesignRequestId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ask-{}", self.0)
    }
}

impl FromStr for EvaluationId {
    type Err = InvalidId;

    fn from_str(text: &str) -> Result<Self, InvalidId> {
        let invalid = || InvalidId::new("must be the id of an evaluation, such as eval-7", text);
        let ShardedNumber { shard, number } = parse_sharded(text, "eval").ok_or_else(invalid)?;
        Ok(Self { shard, number })
    }
}

impl fmt::Display for EvaluationId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_id(f, self.shard.as_ref(), format_args!("eval-{}", self.number))
    }
}

/// Draws `count` letters and digits, at most 16, from the operating system's randomness.
#[must_use]
pub fn random_token(count: usize) -> String {
    const LETTERS: &[u8; 32] = b"abcdefghijkmnpqrstuvwxyz23456789";
    let bytes = entropy();
    bytes.iter().cycle().take(count.min(16)).map(|b| char::from(LETTERS[usize::from(b % 32)])).collect()
}

/// Draws a run's seed, from those that users may choose (below 2⁵¹), from the operating system's randomness.
#[must_use]
pub fn random_seed() -> u64 {
    let bytes = entropy();
    bytes.iter().take(8).fold(0u64, |seed, &b| (seed << 8) | u64::from(b)) >> 13
}

/// Random bytes of the operating system. Only names and seeds of new things come from here, never what follows from them.
fn entropy() -> [u8; 16] {
    let mut bytes = [0; 16];
    rand::TryRng::try_fill_bytes(&mut rand::rngs::SysRng, &mut bytes)
        .expect("the operating system provides randomness");
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn valid_ids_parse_and_others_are_refused() {
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
        for bad in
            ["", "A", "a b", "../x", &"x".repeat(65), ".run", "east.", "EAST.run", "a.b.c", "too-long.run"]
        {
            assert!(bad.parse::<RunId>().is_err(), "{bad}");
        }
        let run: RunId = "east.run-1".parse().unwrap();
        assert_eq!(run.shard(), "east".parse().ok());
        assert_eq!(RunId::generate(run.shard().as_ref()).shard(), run.shard());
        assert_eq!("layout-7".parse(), Ok(LayoutId { shard: None, number: 7 }));
        let layout: LayoutId = "east.layout-7".parse().unwrap();
        assert_eq!(layout, LayoutId::of_run(run.as_str(), 7));
        assert!(layout.may_be_of(&run) && !layout.may_be_of(&"run-1".parse().unwrap()));
        assert_eq!("west.eval-3".parse::<EvaluationId>().unwrap().to_string(), "west.eval-3");
        assert_eq!(DesignRequestId(12).to_string().parse(), Ok(DesignRequestId(12)));
        for bad in ["", "layout", "layout-", "layout-0", "layout-07", "layout--7", "ask-7", "7", ".layout-7"]
        {
            assert!(bad.parse::<LayoutId>().is_err(), "{bad}");
        }
        assert_eq!(random_token(6).len(), 6);
        assert!(random_seed() < 1 << 53);
    }

    proptest::proptest! {
        /// Each thing has one id: what parses is formatted as it was written.
        #[test]
        fn parsed_id_has_the_same_text(text in proptest::prop_oneof![
            ".{0,40}",
            "(ep_)?[0-9]{1,20}-[a-z0-9]{5,7}(_[0-9]{1,12})?",
            "([a-z0-9]{0,17}\\.)?(layout|ask|eval)-[0-9+-]{1,20}",
            "([a-z0-9]{0,17}\\.)?[a-z0-9_-]{0,70}",
        ]) {
            let formatted = [
                text.parse::<RunId>().map(|id| id.to_string()),
                text.parse::<LeaseId>().map(|id| id.to_string()),
                text.parse::<EpisodeId>().map(|id| id.to_string()),
                text.parse::<LayoutId>().map(|id| id.to_string()),
                text.parse::<EvaluationId>().map(|id| id.to_string()),
                text.parse::<DesignRequestId>().map(|id| id.to_string()),
            ];
            for formatted in formatted.into_iter().flatten() {
                proptest::prop_assert_eq!(&formatted, &text);
            }
        }
    }
}
