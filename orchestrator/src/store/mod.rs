//! SQL, and nothing else: one file per table family, functions taking a connection. SQL is written here and nowhere
//! else.

pub mod asks;
mod backup;
pub mod brackets;
pub mod columns;
pub mod critiques;
pub mod curriculum;
pub mod design_counts;
pub mod episodes;
pub mod events;
pub mod failures;
pub mod groups;
pub mod inertial;
pub mod layouts;
pub mod leases;
pub mod marks;
mod open;
mod pack;
#[cfg(test)]
mod plans;
pub mod policies;
pub mod progress;
pub mod proposals;
pub mod runs;
pub mod scenarios;
pub mod serving;
pub mod sums;
pub mod trajectories;
pub mod verdicts;

pub use open::{Claim, OpenError, claim, fold, folder, reader, writer};

use env_core::{LogError, ScenarioError};

/// What the store can fail with.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The database said no.
    #[error("the database failed: {0}")]
    Database(#[from] sqlx::Error),
    /// Something stored cannot be read back: the file was changed by hand, or by a newer version.
    #[error("{what} in the database cannot be read: {reason}")]
    Unreadable {
        /// What it is.
        what: &'static str,
        /// Why.
        reason: String,
    },
}

impl StoreError {
    pub(crate) fn unreadable(what: &'static str, reason: impl std::fmt::Display) -> Self {
        Self::Unreadable { what, reason: format!("{reason}") }
    }
}

impl From<ScenarioError> for StoreError {
    fn from(error: ScenarioError) -> Self {
        Self::unreadable("a scenario", error)
    }
}

impl From<LogError> for StoreError {
    fn from(error: LogError) -> Self {
        Self::unreadable("an action log", error)
    }
}

pub(crate) fn to_json<T: serde::Serialize>(value: &T) -> Result<String, StoreError> {
    serde_json::to_string(value).map_err(|error| StoreError::unreadable("a value", error))
}

pub(crate) fn from_json<T: serde::de::DeserializeOwned>(
    what: &'static str,
    text: &str,
) -> Result<T, StoreError> {
    serde_json::from_str(text).map_err(|error| StoreError::unreadable(what, error))
}

/// Rows that one statement writes at most: each is a turn of two threads, and each number of them a statement to prepare.
pub(crate) const ROWS: usize = 64;

/// Ids for a statement: a JSON list, to be read with `unhex(value)` from `json_each`. One statement for many rows: each
/// is a turn of two threads, which costs more than a row.
pub(crate) fn hex_list<T: AsRef<[u8]>>(ids: &[T]) -> Result<String, StoreError> {
    let hex = |id: &T| id.as_ref().iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    to_json(&ids.iter().map(hex).collect::<Vec<_>>())
}

/// What tells one report from another.
#[must_use]
pub(crate) fn digest(bytes: &[u8]) -> [u8; 16] {
    let mut digest = [0; 16];
    digest.copy_from_slice(&blake3::hash(bytes).as_bytes()[..16]);
    digest
}

/// SQLite holds signed integers; seqs and seeds are below 2⁵³.
pub(crate) fn signed(value: u64) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}

/// Back again; what is negative was never stored by us.
pub(crate) fn unsigned(value: i64) -> u64 {
    u64::try_from(value).unwrap_or(0)
}

/// Small counts.
pub(crate) fn small(value: i64) -> u32 {
    u32::try_from(value).unwrap_or(0)
}
