//! SQL, and nothing else: one file per table family, functions taking a connection. SQL is written here and nowhere
//! else.

pub mod asks;
mod backup;
pub mod brackets;
mod claim;
pub mod closings;
pub mod columns;
pub mod critiques;
pub mod curriculum;
pub mod design_counts;
pub mod episodes;
pub mod evaluations;
pub mod events;
pub mod failures;
pub mod folds;
pub mod groups;
pub mod history;
pub mod inertial;
pub mod layouts;
pub mod leases;
pub mod marks;
mod open;
pub mod overview;
mod pack;
#[cfg(test)]
mod plans;
pub mod policies;
pub mod progress;
pub mod proposals;
pub mod pulse;
pub mod refills;
pub mod retention;
pub mod runs;
pub mod scenarios;
pub mod search;
pub mod serving;
pub mod sums;
pub mod survey;
pub mod sweep;
pub mod times;
pub mod tokens;
pub mod trajectories;
pub mod verdicts;
pub mod versions;

pub use backup::copy;
pub use claim::{Claim, claim};
pub use open::{OpenError, fold, folder, reader, reader_of_current, vacuum, writer};

use env_core::{LogError, ScenarioError};

/// What the store can fail with.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The database said no.
    #[error("the database failed: {0}")]
    Database(#[from] sqlx::Error),
    /// The database undid all that was under way.
    #[error("the database undid what was under way: {0}")]
    Undone(Trouble),
    /// Something stored cannot be read back: the file was changed by hand, or by a newer version.
    #[error("{what} in the database cannot be read: {reason}")]
    Unreadable {
        /// What it is.
        what: &'static str,
        /// Why.
        reason: String,
    },
}

/// What keeps a database from being used that is whole: it can be again when that is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Trouble {
    /// No room.
    #[error("the disk is full, or the file may not grow; make room, and it goes on by itself")]
    Full,
    /// Somebody else has it.
    #[error("another process holds the database; it goes on by itself when that lets go")]
    Locked,
    /// Reads or writes fail.
    #[error(
        "the disk fails, or the file or its folder may not be used; the server's log has the system's word for it"
    )]
    Disk,
    /// What is written goes nowhere.
    #[error(
        "the database's file, or the .lock beside it, was removed or replaced while it was served; nothing more is taken: stop the server, put the file back, and start it again"
    )]
    Gone,
}

/// SQLite's primary result code, the low byte of any (sqlite.org/rescode.html).
fn primary_code(error: &sqlx::Error) -> Option<i32> {
    let code = error.as_database_error()?.code()?.parse::<i32>().ok()?;
    Some(code & 0xff)
}

impl Trouble {
    fn of(error: &sqlx::Error) -> Option<Self> {
        match primary_code(error)? {
            13 => Some(Self::Full),
            5 | 6 => Some(Self::Locked),
            8 | 10 | 14 => Some(Self::Disk),
            _ => None,
        }
    }
}

impl StoreError {
    /// Why it cannot be used now, where that is for a while.
    #[must_use]
    pub fn trouble(&self) -> Option<Trouble> {
        match self {
            Self::Database(error) => Trouble::of(error),
            Self::Undone(trouble) => Some(*trouble),
            Self::Unreadable { .. } => None,
        }
    }

    /// Whether the file itself is damaged: pages that are none, or of another file.
    #[must_use]
    pub fn is_damage(&self) -> bool {
        matches!(self, Self::Database(error) if matches!(primary_code(error), Some(11 | 26)))
    }

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
