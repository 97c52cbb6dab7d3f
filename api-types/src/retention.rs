//! Number of episodes that a run keeps whole.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Numbers of episodes that a run keeps complete. The server keeps only the results of older ones.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RetentionRequest {
    /// Number of episodes of leases of groups, or `all` (default 50 000).
    pub episodes: Option<RetentionLimit>,
    /// Number of episodes of leases of columns, or `all` (default 10 000 000).
    pub claimed: Option<RetentionLimit>,
}

/// Number of episodes that a run keeps complete.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum RetentionLimit {
    /// The newest episodes, at most this many.
    Newest(u32),
    /// Every episode: the word `all`.
    All(AllEpisodes),
}

/// The word `all` in JSON.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum AllEpisodes {
    /// The only value, `all`.
    All,
}

impl<'de> Deserialize<'de> for RetentionLimit {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct LimitVisitor;

        impl serde::de::Visitor<'_> for LimitVisitor {
            type Value = RetentionLimit;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "a whole number from 0 to {}, or \"all\"", u32::MAX)
            }

            fn visit_u64<E: serde::de::Error>(self, number: u64) -> Result<RetentionLimit, E> {
                u32::try_from(number)
                    .map(RetentionLimit::Newest)
                    .map_err(|_| E::invalid_value(serde::de::Unexpected::Unsigned(number), &self))
            }

            fn visit_str<E: serde::de::Error>(self, word: &str) -> Result<RetentionLimit, E> {
                if word == "all" {
                    Ok(RetentionLimit::All(AllEpisodes::All))
                } else {
                    Err(E::invalid_value(serde::de::Unexpected::Str(word), &self))
                }
            }
        }

        deserializer.deserialize_any(LimitVisitor)
    }
}

impl RetentionLimit {
    /// Returns the maximum number of episodes; `i64::MAX` for `all`.
    #[must_use]
    pub fn limit(self) -> i64 {
        match self {
            Self::Newest(count) => i64::from(count),
            Self::All(_) => i64::MAX,
        }
    }
}
