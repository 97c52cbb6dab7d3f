//! How many episodes a run keeps whole.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// How many episodes are kept whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum Keep {
    /// At most this many, the newest.
    Newest(u32),
    /// `all`: every episode is kept.
    All(All),
}

/// The word `all` in JSON.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum All {
    /// The only value, `all`.
    All,
}

impl<'de> Deserialize<'de> for Keep {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct KeepVisitor;

        impl serde::de::Visitor<'_> for KeepVisitor {
            type Value = Keep;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "a whole number from 0 to {}, or \"all\"", u32::MAX)
            }

            fn visit_u64<E: serde::de::Error>(self, number: u64) -> Result<Keep, E> {
                u32::try_from(number)
                    .map(Keep::Newest)
                    .map_err(|_| E::invalid_value(serde::de::Unexpected::Unsigned(number), &self))
            }

            fn visit_str<E: serde::de::Error>(self, word: &str) -> Result<Keep, E> {
                if word == "all" {
                    Ok(Keep::All(All::All))
                } else {
                    Err(E::invalid_value(serde::de::Unexpected::Str(word), &self))
                }
            }
        }

        deserializer.deserialize_any(KeepVisitor)
    }
}

impl Keep {
    /// Returns the maximum number of episodes; `i64::MAX` for `all`.
    #[must_use]
    pub fn limit(self) -> i64 {
        match self {
            Self::Newest(count) => i64::from(count),
            Self::All(_) => i64::MAX,
        }
    }
}

/// Episodes that a run keeps whole. Older ones are compacted: how each came out is kept, its actions and scenario only where a
/// level move, a layout or an example of a failure rests on them. Leases for evaluation are never compacted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Retention {
    /// The newest episodes of leases of groups.
    pub episodes: Keep,
    /// The newest episodes of leases of columns.
    pub claimed: Keep,
}

impl Default for Retention {
    fn default() -> Self {
        Self { episodes: Keep::Newest(50_000), claimed: Keep::Newest(10_000_000) }
    }
}

impl Retention {
    /// Returns the retention of runs whose stored settings have none: everything is kept.
    pub(crate) const fn everything() -> Self {
        Self { episodes: Keep::All(All::All), claimed: Keep::All(All::All) }
    }

    /// Returns this retention with the fields that a request sets.
    #[must_use]
    pub fn with(self, request: RetentionRequest) -> Self {
        Self {
            episodes: request.episodes.unwrap_or(self.episodes),
            claimed: request.claimed.unwrap_or(self.claimed),
        }
    }
}

/// Request to keep episodes whole: a number of episodes, or `all`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RetentionRequest {
    /// The newest episodes of leases of groups (50 000).
    pub episodes: Option<Keep>,
    /// The newest episodes of leases of columns (10 000 000).
    pub claimed: Option<Keep>,
}
