//! Tags of runs. Table `run_tags`.

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;

use env_core::text::{MAX_QUOTED_CHARS, shorten};
use serde::Serialize;
use sqlx::{SqliteConnection, query};

use super::{StoreError, to_json};

/// Tag of a run: 1 to 64 of `a-z 0-9 _ . : -`, beginning with a letter or a digit.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(transparent)]
pub struct RunTag(String);

/// A text that is not a tag.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("must have 1 to 64 of a-z, 0-9, _, ., : and -, and begin with a letter or a digit, got {0:?}")]
pub struct InvalidTag(String);

impl RunTag {
    /// Maximum length of a tag.
    const MAX_CHARS: usize = 64;

    /// The tag as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for RunTag {
    type Err = InvalidTag;

    fn from_str(text: &str) -> Result<Self, InvalidTag> {
        let is_first = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit();
        let is_valid = |c: char| is_first(c) || "_.:-".contains(c);
        if text.len() <= Self::MAX_CHARS && text.starts_with(is_first) && text.chars().all(is_valid) {
            Ok(Self(text.to_owned()))
        } else {
            Err(InvalidTag(shorten(text, MAX_QUOTED_CHARS)))
        }
    }
}

impl fmt::Display for RunTag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Replaces the tags of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn replace(
    conn: &mut SqliteConnection,
    run: &str,
    tags: &BTreeSet<RunTag>,
) -> Result<(), StoreError> {
    query!("DELETE FROM run_tags WHERE run = ?", run).execute(&mut *conn).await?;
    let tags = to_json(tags)?;
    query!(
        "INSERT INTO run_tags (run, tag, run_created_at)
         SELECT r.id, t.value, r.created_at FROM json_each(?) AS t CROSS JOIN runs r ON r.id = ?",
        tags,
        run
    )
    .execute(conn)
    .await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn valid_tags_parse_and_others_are_refused() {
        for tag in ["a", "0", "baseline", "lr:3e-4", "v1.2_b-c", &"x".repeat(64)] {
            assert_eq!(tag.parse::<RunTag>().map(|tag| tag.to_string()), Ok(tag.to_owned()));
        }
        for tag in ["", "A", "-a", ".a", ":a", "_a", "a b", "a,b", "a/b", "ä", "a\n", &"x".repeat(65)] {
            assert!(tag.parse::<RunTag>().is_err(), "{tag}");
        }
    }
}
