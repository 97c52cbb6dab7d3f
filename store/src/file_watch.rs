//! Watch on the files of an open database: SQLite does not notice that a file was removed, replaced or truncated by another program.
//!
//! The watch reads attributes of files only. It must not open them: closing a file drops the locks that SQLite has on it
//! (sqlite.org/howtocorrupt.html, 2.2).

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use sqlx::SqliteConnection;

use super::{Outage, StoreError};

/// Bytes of the header of a write-ahead log, and of the header of each frame (sqlite.org/fileformat2.html, 4.1).
const LOG_HEADER_BYTES: u64 = 32;
const FRAME_HEADER_BYTES: u64 = 24;

/// Identity of a file, independent of its name. Systems other than Unix have none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FileIdentity {
    device: u64,
    inode: u64,
}

/// State of the files of an open database.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileState {
    /// All files are at their paths, and none is shorter than before.
    Intact,
    /// A file was removed or replaced.
    Replaced,
    /// The database or its write-ahead log is shorter than before.
    Shrunk,
}

/// The files of an open database, as they were when they were seen last.
#[derive(Debug)]
pub(super) struct FileWatch {
    /// The database, its write-ahead log and its shared memory, with their identities.
    files: [(PathBuf, Option<FileIdentity>); 3],
    /// Largest size of the database, bytes.
    database_bytes: AtomicU64,
    /// Largest size of the write-ahead log, bytes.
    log_bytes: AtomicU64,
}

impl FileWatch {
    /// Starts a watch on the files of a database that is open.
    pub(super) fn start(database: &Path) -> Self {
        let file = |ending: &str| {
            let mut path = database.as_os_str().to_owned();
            path.push(ending);
            let path = PathBuf::from(path);
            let identity = identity_at(&path);
            (path, identity)
        };
        let files = [file(""), file("-wal"), file("-shm")];
        let (database_bytes, log_bytes) =
            (AtomicU64::new(size_of(&files[0].0)), AtomicU64::new(size_of(&files[1].0)));
        Self { files, database_bytes, log_bytes }
    }

    /// True if each file that existed at the start is at its path.
    pub(super) fn is_in_place(&self) -> bool {
        self.files.iter().all(|(path, opened)| opened.is_none() || identity_at(path) == *opened)
    }

    /// Compares the files with what was seen last.
    pub(super) fn state(&self) -> FileState {
        if !self.is_in_place() {
            return FileState::Replaced;
        }
        let [(database, _), (log, _), _] = &self.files;
        let grows = |path: &Path, largest: &AtomicU64| {
            let bytes = size_of(path);
            largest.fetch_max(bytes, Ordering::Relaxed) <= bytes
        };
        let has_grown = [grows(database, &self.database_bytes), grows(log, &self.log_bytes)];
        if has_grown == [true; 2] { FileState::Intact } else { FileState::Shrunk }
    }

    /// Finds out whether files that became shorter still have all pages. Another program may have truncated the log after a
    /// checkpoint, or vacuumed the database. The connection must not be in a transaction.
    ///
    /// # Errors
    /// Returns [`StoreError::RolledBack`] with [`Outage::Damaged`] if pages are missing, or the error of SQLite.
    pub(super) async fn verify_sizes(&self, conn: &mut SqliteConnection) -> Result<(), StoreError> {
        let [(database, _), (log, _), _] = &self.files;
        let log_state: (i64, i64, i64) =
            sqlx::query_as("PRAGMA wal_checkpoint(NOOP)").fetch_one(&mut *conn).await?;
        let page: i64 = sqlx::query_scalar("PRAGMA page_size").fetch_one(&mut *conn).await?;
        let pages: i64 = sqlx::query_scalar("PRAGMA page_count").fetch_one(conn).await?;
        let [frames, page, pages] =
            [log_state.1, page, pages].map(|number| u64::try_from(number).unwrap_or(0));
        let (database_bytes, log_bytes) = (size_of(database), size_of(log));
        let needed_log =
            if frames == 0 { 0 } else { LOG_HEADER_BYTES + frames * (page + FRAME_HEADER_BYTES) };
        // Pages beyond the largest size that was seen may be in the log only.
        let needed_database = (pages * page).min(self.database_bytes.load(Ordering::Relaxed));
        if log_bytes < needed_log || database_bytes < needed_database {
            tracing::error!(
                log_bytes,
                needed_log,
                database_bytes,
                needed_database,
                "The database or its write-ahead log was truncated by another program."
            );
            return Err(StoreError::RolledBack(Outage::Damaged));
        }
        self.database_bytes.store(database_bytes, Ordering::Relaxed);
        self.log_bytes.store(log_bytes, Ordering::Relaxed);
        Ok(())
    }
}

/// Identity of the file at a path; `None` if there is no file.
pub(super) fn identity_at(path: &Path) -> Option<FileIdentity> {
    std::fs::metadata(path).ok().as_ref().and_then(identity)
}

/// Identity of a file by its attributes.
pub(super) fn identity(file: &std::fs::Metadata) -> Option<FileIdentity> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        Some(FileIdentity { device: file.dev(), inode: file.ino() })
    }
    #[cfg(not(unix))]
    {
        let _ = file;
        None
    }
}

/// Size of the file at a path in bytes; 0 if there is no file.
fn size_of(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |file| file.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{checkpoint, open_maintenance, open_readers, open_writer, vacuum};

    async fn open(path: &Path) -> (SqliteConnection, FileWatch) {
        let mut conn = open_writer(path).await.expect("a new database");
        for statement in ["CREATE TABLE filler (body BLOB)", "INSERT INTO filler VALUES (zeroblob(400000))"] {
            sqlx::query(statement).execute(&mut conn).await.expect("the statement succeeds");
        }
        checkpoint(&mut conn).await.expect("a checkpoint");
        sqlx::query("INSERT INTO filler VALUES (zeroblob(400000))").execute(&mut conn).await.expect("a row");
        let watch = FileWatch::start(path);
        (conn, watch)
    }

    fn truncate(path: &Path, ending: &str, bytes: u64) {
        let file = std::fs::File::options().write(true).open(format!("{}{ending}", path.display()));
        file.expect("the file exists").set_len(bytes).expect("the file is writable");
    }

    #[tokio::test]
    async fn truncated_files_are_damaged() {
        for (ending, bytes) in [("", 4096), ("-wal", 0), ("-wal", 50_000)] {
            let folder = tempfile::tempdir().expect("a folder");
            let path = folder.path().join("db");
            let (mut conn, watch) = open(&path).await;
            assert_eq!(watch.state(), FileState::Intact);
            truncate(&path, ending, bytes);
            assert_eq!(watch.state(), FileState::Shrunk, "{ending}");
            let verified = watch.verify_sizes(&mut conn).await;
            assert!(verified.is_err_and(|error| error.is_damage()), "{ending}");
        }
    }

    #[tokio::test]
    async fn checkpoint_and_vacuum_by_others_are_no_damage() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("db");
        let (mut conn, watch) = open(&path).await;
        let mut other = open_maintenance(&path).await.expect("a connection");
        for statement in ["PRAGMA wal_checkpoint(TRUNCATE)", "DELETE FROM filler"] {
            sqlx::query(statement).execute(&mut other).await.expect("the statement succeeds");
        }
        assert_eq!(watch.state(), FileState::Shrunk);
        watch.verify_sizes(&mut conn).await.expect("the log was checkpointed");
        assert_eq!(watch.state(), FileState::Intact);
        vacuum(&path).await.expect("the database can be vacuumed");
        assert_eq!(watch.state(), FileState::Shrunk);
        watch.verify_sizes(&mut conn).await.expect("the database was vacuumed");
        assert_eq!(watch.state(), FileState::Intact);
    }

    /// A connection that opened the copy would delete the log of the open database when it closes.
    #[tokio::test]
    async fn readers_do_not_open_a_replaced_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("db");
        let (_conn, watch) = open(&path).await;
        let readers = open_readers(&path).await.expect("a pool");
        let aside = folder.path().join("aside");
        std::fs::rename(&path, &aside).expect("the file is moved");
        let copied = std::fs::copy(&aside, &path).expect("the file is copied");
        assert!(copied > 0);
        let mut used = Vec::new();
        for _ in 0..readers.options().get_max_connections() {
            let mut reader = readers.acquire().await.expect("a free connection");
            let rows: i64 = sqlx::query_scalar("SELECT count(*) FROM filler")
                .fetch_one(&mut *reader)
                .await
                .expect("the table is there");
            assert_eq!(rows, 2);
            used.push(reader);
        }
        drop(used);
        readers.close().await;
        std::fs::rename(&aside, &path).expect("the file is moved back");
        assert_eq!(watch.state(), FileState::Intact);
    }
}
