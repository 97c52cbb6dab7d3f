//! Exclusive lock of a database file: one database, one server. The lock file has the URL of the server that holds it.

use std::io::{Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use sqlx::SqliteConnection;

use super::StoreError;
use super::file_watch::{FileState, FileWatch, identity, identity_at};
use super::open_error::{OpenError, is_no_file};

/// Lock of a database for this process, held while this value lives.
///
/// The operating system holds the lock, so that the lock of a killed server is free at once.
#[derive(Debug)]
pub struct DatabaseLock {
    /// The file that is locked.
    lock: std::fs::File,
    /// Path of that file: the database's path and `.lock`.
    lock_path: PathBuf,
    /// Path of the database.
    path: PathBuf,
    /// Watch on the files of the database that was opened.
    watch: OnceLock<FileWatch>,
}

impl DatabaseLock {
    /// Locks a database for this process.
    ///
    /// # Errors
    /// Returns [`OpenError::Locked`] if another process holds the lock, [`OpenError::Linked`] if the file has several names,
    /// and [`OpenError::NoFile`], [`OpenError::NoFolder`] or [`OpenError::ReadOnly`] if the lock file cannot be created.
    pub fn acquire(path: &Path) -> Result<Self, OpenError> {
        let name = path.display().to_string();
        if is_no_file(path) {
            return Err(OpenError::NoFile(name));
        }
        if link_count(path) > 1 {
            return Err(OpenError::Linked(name));
        }
        // All symbolic links to a database share its lock. A database that does not exist yet has its own path.
        let path = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let lock_path = lock_path(&path);
        // The file is not truncated, because it has the URL of a server that may hold the lock.
        let options = std::fs::OpenOptions::new().read(true).write(true).create(true).truncate(false).clone();
        let lock = options.open(&lock_path).map_err(|error| match error.kind() {
            std::io::ErrorKind::PermissionDenied | std::io::ErrorKind::ReadOnlyFilesystem => {
                OpenError::ReadOnly(name.clone())
            }
            std::io::ErrorKind::NotFound => OpenError::NoFolder(name.clone()),
            _ => OpenError::Other { path: name.clone(), reason: error.to_string() },
        })?;
        match lock.try_lock() {
            Ok(()) => {
                // A URL that could not be removed belongs to a server that does not respond.
                let _ = lock.set_len(0);
                Ok(Self { lock, lock_path, path, watch: OnceLock::new() })
            }
            Err(std::fs::TryLockError::WouldBlock) => Err(OpenError::Locked(name)),
            Err(std::fs::TryLockError::Error(error)) => {
                Err(OpenError::Other { path: name, reason: error.to_string() })
            }
        }
    }

    /// Writes the URL of the server that holds the lock, for programs on this machine that find the database locked.
    ///
    /// # Errors
    /// Returns an error if the lock file cannot be written.
    pub fn publish_url(&self, url: &str) -> std::io::Result<()> {
        let mut file = &self.lock;
        file.set_len(0)?;
        file.rewind()?;
        file.write_all(url.as_bytes())
    }

    /// Returns the URL of the server that holds the lock of a database, if it published one.
    #[must_use]
    pub fn published_url(path: &Path) -> Option<String> {
        let path = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let url = std::fs::read_to_string(lock_path(&path)).ok()?;
        (!url.trim().is_empty()).then(|| url.trim().to_owned())
    }

    /// Path of the database.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Starts the watch on the files of the database. Call this after opening the database.
    pub fn watch_files(&self) {
        self.watch.get_or_init(|| FileWatch::start(&self.path));
    }

    /// True if the files of the database and the lock file are still at their paths.
    ///
    /// Writes to a file that was removed are lost when the last process closes it.
    #[must_use]
    pub fn is_in_place(&self) -> bool {
        let locked = self.lock.metadata().ok().as_ref().and_then(identity);
        locked == identity_at(&self.lock_path) && self.watch.get().is_none_or(FileWatch::is_in_place)
    }

    /// Compares the files of the database with what was seen last.
    #[must_use]
    pub fn file_state(&self) -> FileState {
        match self.watch.get() {
            _ if !self.is_in_place() => FileState::Replaced,
            Some(watch) => watch.state(),
            None => FileState::Intact,
        }
    }

    /// Finds out whether files that became shorter still have all pages. The connection must not be in a transaction.
    ///
    /// # Errors
    /// Returns [`StoreError::RolledBack`] with [`Outage::Damaged`](super::Outage::Damaged) if pages are missing, or the error of
    /// SQLite.
    pub async fn verify_sizes(&self, conn: &mut SqliteConnection) -> Result<(), StoreError> {
        match self.watch.get() {
            Some(watch) => watch.verify_sizes(conn).await,
            None => Ok(()),
        }
    }
}

impl Drop for DatabaseLock {
    fn drop(&mut self) {
        // If the URL stays, a client reports that no server responds there.
        let _ = self.lock.set_len(0);
        // Closing is not enough: a child process that is being spawned holds a copy of the descriptor until its own program
        // starts. If unlocking fails, the system unlocks when the last copy closes.
        let _ = self.lock.unlock();
    }
}

/// Returns the path of a database's lock file.
fn lock_path(path: &Path) -> PathBuf {
    let mut lock_path = path.as_os_str().to_owned();
    lock_path.push(".lock");
    PathBuf::from(lock_path)
}

/// Number of hard links to a file.
fn link_count(path: &Path) -> u64 {
    #[cfg(unix)]
    return std::fs::metadata(path).map_or(1, |file| std::os::unix::fs::MetadataExt::nlink(&file));
    #[cfg(not(unix))]
    1
}

#[cfg(all(test, unix))]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::super::OpenError;
    use super::DatabaseLock;

    #[test]
    fn lock_is_shared_by_all_links_to_a_database() {
        let folder = tempfile::tempdir().expect("a folder");
        let (db, link) = (folder.path().join("db"), folder.path().join("link"));
        std::fs::write(&db, "").expect("a file");
        std::os::unix::fs::symlink("db", &link).expect("a link");
        let first = DatabaseLock::acquire(&link).expect("the lock is free");
        assert!(DatabaseLock::acquire(&db).is_err() && DatabaseLock::acquire(&link).is_err());
        drop(first);
        assert!(DatabaseLock::acquire(&db).is_ok());
        let other = folder.path().join("other");
        std::fs::hard_link(&db, &other).expect("a second name");
        assert!(matches!(DatabaseLock::acquire(&db), Err(OpenError::Linked(_))));
        std::fs::remove_file(other).expect("the second name exists");
        assert!(DatabaseLock::acquire(&db).is_ok());
        assert!(matches!(DatabaseLock::acquire(folder.path()), Err(OpenError::NoFile(_))));
    }

    #[test]
    fn holder_of_the_lock_publishes_its_url() {
        let folder = tempfile::tempdir().expect("a folder");
        let db = folder.path().join("db");
        assert_eq!(DatabaseLock::published_url(&db), None);
        let lock = DatabaseLock::acquire(&db).expect("the lock is free");
        assert_eq!(DatabaseLock::published_url(&db), None);
        lock.publish_url("http://127.0.0.1:8700").expect("the lock file is writable");
        lock.publish_url("http://[::1]:1").expect("the lock file is writable");
        assert!(DatabaseLock::acquire(&db).is_err());
        assert_eq!(DatabaseLock::published_url(&db).as_deref(), Some("http://[::1]:1"));
        drop(lock);
        assert_eq!(DatabaseLock::published_url(&db), None);
    }

    #[test]
    fn removed_or_replaced_file_is_not_in_place() {
        let folder = tempfile::tempdir().expect("a folder");
        let [db, aside, lock_file] = ["db", "aside", "db.lock"].map(|name| folder.path().join(name));
        std::fs::write(&db, "").expect("a file");
        let lock = DatabaseLock::acquire(&db).expect("the lock is free");
        lock.watch_files();
        assert!(lock.is_in_place());
        std::fs::rename(&db, &aside).expect("the file exists");
        assert!(!lock.is_in_place());
        std::fs::write(&db, "").expect("another file");
        assert!(!lock.is_in_place());
        std::fs::rename(&aside, &db).expect("the file exists");
        assert!(lock.is_in_place());
        std::fs::remove_file(&lock_file).expect("the lock file exists");
        assert!(!lock.is_in_place());
    }

    #[test]
    fn released_lock_is_free_while_children_are_spawned() {
        let folder = tempfile::tempdir().expect("a folder");
        let db = folder.path().join("db");
        let done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| {
                    while !done.load(Ordering::Relaxed) {
                        let _ = std::process::Command::new("true").status();
                    }
                });
            }
            let refused = (0..20_000).filter(|_| DatabaseLock::acquire(&db).is_err()).count();
            done.store(true, Ordering::Relaxed);
            assert_eq!(refused, 0);
        });
    }
}
