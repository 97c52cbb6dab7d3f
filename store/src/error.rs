//! Errors of the store.

use env_core::{LogError, ScenarioError};

use super::text_enum::UnknownWord;

/// Failure of a store operation.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// SQLite reported an error.
    #[error("the database failed: {0}")]
    Database(sqlx::Error),
    /// The transaction was rolled back.
    #[error("the transaction was rolled back: {0}")]
    RolledBack(Outage),
    /// All connections that read were in use for too long.
    #[error(
        "all connections that read the database are busy; retry in a few seconds, and ask for smaller pages"
    )]
    ReadersBusy,
    /// A stored value cannot be decoded: the file was changed by hand, or by a newer version.
    #[error("{item} in the database cannot be read: {reason}")]
    Corrupt {
        /// Name of the value, for example `a scenario`.
        item: &'static str,
        /// Why it cannot be decoded.
        reason: String,
    },
}

/// Why the database cannot be used for now, or at all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Outage {
    /// The disk is full.
    #[error("the disk is full, or the file cannot grow; writes resume automatically once space is free")]
    Full,
    /// Another process holds a lock.
    #[error("another process holds the database lock; writes resume automatically once it is released")]
    Locked,
    /// Reads or writes fail.
    #[error(
        "the disk failed or is mounted read-only, or the file or its folder cannot be accessed; the system's log has the reason, and writes resume automatically once the disk works"
    )]
    Disk,
    /// A file of the database was removed or replaced: writes would be lost.
    #[error(
        "the file of the database, or its -wal, -shm or .lock file, was removed or replaced while the server ran; stop the server, restore the file, and start it again"
    )]
    Gone,
    /// The content of the file or of its write-ahead log is damaged. It does not recover by itself. SQLite reports a sector that
    /// cannot be read in the same way.
    #[error(
        "the database or its write-ahead log is damaged, or the disk cannot read it; stop the server, run `sparring db check`, and restore the newest backup if it finds damage"
    )]
    Damaged,
}

impl StoreError {
    /// The outage behind the error, if there is one.
    #[must_use]
    pub fn outage(&self) -> Option<Outage> {
        match self {
            Self::Database(error) => Outage::of(error),
            Self::RolledBack(outage) => Some(*outage),
            Self::ReadersBusy | Self::Corrupt { .. } => None,
        }
    }

    /// True if the file itself is damaged: its pages are malformed or missing, or it is not a database.
    #[must_use]
    pub fn is_damage(&self) -> bool {
        self.outage() == Some(Outage::Damaged)
    }

    /// The error for a stored value that cannot be decoded.
    #[must_use]
    pub fn corrupt(item: &'static str, reason: impl std::fmt::Display) -> Self {
        Self::Corrupt { item, reason: format!("{reason}") }
    }
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        let unknown = match &error {
            sqlx::Error::ColumnDecode { source, .. } => source.downcast_ref::<UnknownWord>().cloned(),
            _ => None,
        };
        match (unknown, error) {
            (Some(unknown), _) => Self::corrupt(unknown.item, unknown),
            (None, sqlx::Error::PoolTimedOut) => Self::ReadersBusy,
            (None, error) => Self::Database(error),
        }
    }
}

impl From<ScenarioError> for StoreError {
    fn from(error: ScenarioError) -> Self {
        Self::corrupt("a scenario", error)
    }
}

impl From<LogError> for StoreError {
    fn from(error: LogError) -> Self {
        Self::corrupt("an action log", error)
    }
}

impl Outage {
    fn of(error: &sqlx::Error) -> Option<Self> {
        if extended_code(error)? == IO_SHORT_READ {
            return Some(Self::Damaged);
        }
        match ResultCode::of(error)? {
            ResultCode::CORRUPT | ResultCode::NOT_A_DATABASE => Some(Self::Damaged),
            ResultCode::FULL => Some(Self::Full),
            ResultCode::BUSY | ResultCode::LOCKED => Some(Self::Locked),
            ResultCode::READ_ONLY | ResultCode::IO | ResultCode::CANNOT_OPEN => Some(Self::Disk),
            _ => None,
        }
    }
}

/// Primary result code of SQLite (sqlite.org/rescode.html).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ResultCode(i32);

impl ResultCode {
    pub(super) const BUSY: Self = Self(5);
    pub(super) const LOCKED: Self = Self(6);
    pub(super) const READ_ONLY: Self = Self(8);
    pub(super) const IO: Self = Self(10);
    pub(super) const CORRUPT: Self = Self(11);
    pub(super) const FULL: Self = Self(13);
    pub(super) const CANNOT_OPEN: Self = Self(14);
    pub(super) const NOT_A_DATABASE: Self = Self(26);

    /// The code of an error that SQLite reported. It is the low byte of the extended code.
    pub(super) fn of(error: &sqlx::Error) -> Option<Self> {
        Some(Self(extended_code(error)? & 0xff))
    }
}

/// Extended code for a file that ends before a page that it must have.
const IO_SHORT_READ: i32 = 522;

/// Extended result code of an error that SQLite reported.
fn extended_code(error: &sqlx::Error) -> Option<i32> {
    error.as_database_error()?.code()?.parse().ok()
}
