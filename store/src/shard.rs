//! Shards: servers among which a team divides its runs, each with its own database. Table `shard`.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use sqlx::{SqliteConnection, query, query_scalar};

use super::StoreError;

/// Name of a shard: 1 to 16 of `a-z 0-9`. Ids begin with it and a dot.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(transparent)]
pub struct Shard(String);

/// A text that is not the name of a shard.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the name of a shard must be 1 to 16 characters of a-z and 0-9, got {0:?}")]
pub struct InvalidShard(String);

/// Parts of an id that may have a shard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IdParts<'a> {
    /// Text before the first dot; none in an id without a dot.
    pub shard: Option<&'a str>,
    /// Text after the dot, or the whole id.
    pub name: &'a str,
}

impl Shard {
    /// Largest number of characters of a name.
    pub const MAX_CHARS: usize = 16;
    /// Largest number of characters that an error shows.
    const MAX_SHOWN_CHARS: usize = 80;

    /// The name as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Returns the shard that an id begins with; `None` for an id without a shard.
    #[must_use]
    pub fn of_id(id: &str) -> Option<Self> {
        split_id(id).shard?.parse().ok()
    }
}

/// Splits an id into its shard and the rest.
#[must_use]
pub fn split_id(id: &str) -> IdParts<'_> {
    match id.split_once('.') {
        Some((shard, name)) => IdParts { shard: Some(shard), name },
        None => IdParts { shard: None, name: id },
    }
}

/// Writes an id after its shard, if it has one.
pub(crate) fn write_id(
    f: &mut fmt::Formatter<'_>,
    shard: Option<&Shard>,
    name: fmt::Arguments<'_>,
) -> fmt::Result {
    match shard {
        Some(shard) => write!(f, "{shard}.{name}"),
        None => f.write_fmt(name),
    }
}

impl FromStr for Shard {
    type Err = InvalidShard;

    fn from_str(text: &str) -> Result<Self, InvalidShard> {
        let is_valid = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit();
        if (1..=Self::MAX_CHARS).contains(&text.len()) && text.chars().all(is_valid) {
            Ok(Self(text.to_owned()))
        } else {
            Err(InvalidShard(text.chars().take(Self::MAX_SHOWN_CHARS).collect()))
        }
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl<'de> Deserialize<'de> for Shard {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// Returns the shard that the database remembers, if it has one.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails, and [`StoreError::Corrupt`] if the stored name is invalid.
pub async fn remembered(conn: &mut SqliteConnection) -> Result<Option<Shard>, StoreError> {
    let name = query_scalar!("SELECT name FROM shard").fetch_optional(conn).await?;
    name.map(|name| name.parse().map_err(|error: InvalidShard| StoreError::corrupt("the shard", error)))
        .transpose()
}

/// Stores the shard of a database that has none.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails, for example because the database has a shard.
pub async fn remember(conn: &mut SqliteConnection, shard: &Shard) -> Result<(), StoreError> {
    let name = shard.as_str();
    query!("INSERT INTO shard (id, name) VALUES (1, ?)", name).execute(conn).await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open_writer;

    #[test]
    fn only_short_plain_names_are_shards() {
        for name in ["a", "0", "east", "eu1", "0123456789abcdef"] {
            assert_eq!(name.parse::<Shard>().map(|shard| shard.to_string()), Ok(name.to_owned()));
        }
        for name in ["", "East", "a.b", "a-b", "a_b", "ä", "0123456789abcdefg"] {
            assert!(name.parse::<Shard>().is_err(), "{name}");
        }
        assert_eq!(Shard::of_id("east.run-1").as_ref().map(Shard::as_str), Some("east"));
        assert_eq!(Shard::of_id("run-1"), None);
        assert_eq!(Shard::of_id("East.run-1"), None);
    }

    #[tokio::test]
    async fn database_remembers_one_shard() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut conn = open_writer(&folder.path().join("db")).await.expect("a database");
        assert_eq!(remembered(&mut conn).await.expect("a query"), None);
        let shard: Shard = "east".parse().expect("a shard");
        remember(&mut conn, &shard).await.expect("the database has no shard");
        assert_eq!(remembered(&mut conn).await.expect("a query"), Some(shard));
        let other: Shard = "west".parse().expect("a shard");
        assert!(remember(&mut conn, &other).await.is_err());
    }
}
