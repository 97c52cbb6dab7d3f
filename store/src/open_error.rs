//! Why a database cannot be opened.

use std::io::ErrorKind;
use std::path::Path;

use clock::rfc3339;

use super::backup_list::{self, Backup};
use super::error::ResultCode;

/// Why a database cannot be opened, and how to fix it.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The file is not a database.
    #[error("{0} is not an SQLite database: give another path with --db, or move the file away")]
    NotADatabase(String),
    /// Pages of the database are damaged.
    #[error(
        "{path} is corrupt: if you just restored it, delete the old {path}-wal and {path}-shm; otherwise restore a backup that `sparring db backup` made{newest}"
    )]
    Damaged {
        /// Path of the database.
        path: String,
        /// Words that name the newest backup; empty if none was found.
        newest: String,
    },
    /// The database belongs to another application.
    #[error("{0} is a database of another application: give another path with --db")]
    Foreign(String),
    /// A newer version wrote the database.
    #[error(
        "{path} was written by a newer Sparring (schema {found}, this one knows {known}): upgrade Sparring, or give another path with --db"
    )]
    Newer {
        /// Path of the database.
        path: String,
        /// Schema version of the database.
        found: i64,
        /// Newest schema version that this program knows.
        known: i64,
    },
    /// An older version wrote the database, and this command does not migrate it.
    #[error(
        "{path} was written by an older Sparring (schema {found}, this one has {known}): run `sparring serve` on it once, which backs up and migrates the database"
    )]
    Older {
        /// Path of the database.
        path: String,
        /// Schema version of the database.
        found: i64,
        /// Schema version of this program.
        known: i64,
    },
    /// The process has no permission to write.
    #[error("{0} cannot be written: check the permissions of the file and its folder")]
    ReadOnly(String),
    /// Another process has locked the database.
    #[error("{0} is locked by another process: stop the other server, or give another path with --db")]
    Locked(String),
    /// The file has several names, and each would have its own write-ahead log (sqlite.org/howtocorrupt.html).
    #[error(
        "{0} is hard-linked, and opening it by both names corrupts it: copy it with `sparring db backup`, or remove the other name"
    )]
    Linked(String),
    /// The path is a folder or a device.
    #[error("{0} is not a file: give the path of a new or existing file with --db")]
    NoFile(String),
    /// The disk is full.
    #[error("{0} cannot be written: the disk is full, or the file may not grow; free some space and retry")]
    Full(String),
    /// The folder of a new database does not exist.
    #[error(
        "{0} cannot be created: its folder does not exist; create the folder, or give another path with --db"
    )]
    NoFolder(String),
    /// The file does not exist.
    #[error("{0} does not exist: check the path in --db")]
    Missing(String),
    /// The process has no permission to open the file.
    #[error("{0} cannot be opened: permission denied; check the permissions of the file and its folder")]
    NoPermission(String),
    /// SQLite cannot open the file for another reason, such as too many open files.
    #[error("{0} cannot be opened: check the file and its folder")]
    CannotOpen(String),
    /// The database needs a migration, and the copy before it cannot be made.
    #[error(
        "{path} has an older schema ({schema}) and was not migrated, because the copy before the migration failed: {reason}; free some space in its folder, or move it"
    )]
    NoCopy {
        /// Path of the database.
        path: String,
        /// Schema version of the database.
        schema: i64,
        /// Why the copy cannot be made.
        reason: String,
    },
    /// Any other failure to open.
    #[error("{path} cannot be opened: {reason}")]
    Other {
        /// Path of the database.
        path: String,
        /// Message of the operating system.
        reason: String,
    },
}

impl OpenError {
    /// The error for a database at this path that SQLite failed to open.
    pub(super) fn from_sqlx(path: &Path, error: &sqlx::Error) -> Self {
        let path = path.display().to_string();
        match ResultCode::of(error) {
            Some(ResultCode::NOT_A_DATABASE) => Self::NotADatabase(path),
            Some(ResultCode::CORRUPT) => Self::damaged(Path::new(&path)),
            Some(ResultCode::READ_ONLY) => Self::ReadOnly(path),
            Some(ResultCode::BUSY | ResultCode::LOCKED) => Self::Locked(path),
            Some(ResultCode::CANNOT_OPEN) => Self::cannot_open(path),
            Some(ResultCode::FULL) => Self::Full(path),
            _ => Self::Other { path, reason: error.to_string() },
        }
    }
}

impl OpenError {
    /// The error for a database whose pages are damaged. It names the newest backup.
    #[must_use]
    pub fn damaged(path: &Path) -> Self {
        let newest = backup_list::newest(path)
            .map(|Backup { path, at }| format!("; the newest is {} of {}", path.display(), rfc3339(at)));
        Self::Damaged { path: path.display().to_string(), newest: newest.unwrap_or_default() }
    }

    /// The error for a database at this path that SQLite cannot open, without a reason.
    fn cannot_open(path: String) -> Self {
        match std::fs::File::open(&path).map_err(|error| error.kind()) {
            Err(ErrorKind::NotFound) => Self::Missing(path),
            Err(ErrorKind::PermissionDenied) => Self::NoPermission(path),
            _ => Self::CannotOpen(path),
        }
    }
}

/// True if something exists at the path that is not a file.
pub(super) fn is_no_file(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|entry| !entry.is_file())
}
