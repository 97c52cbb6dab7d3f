//! One database, one server: a claim on the file, and whether it still is what was claimed.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use super::open::OpenError;

/// Keeps a database to one server: held as long as this lives, by the operating system, so that a server that is killed
/// lets go of it.
#[derive(Debug)]
pub struct Claim {
    /// What is locked.
    lock: std::fs::File,
    /// Where it lies.
    beside: PathBuf,
    /// Where the database lies.
    path: PathBuf,
    /// Which file that was when it was opened.
    opened: OnceLock<Option<Identity>>,
}

/// A file, whatever its name: its device and its number there. None where the system has no such thing.
type Identity = (u64, u64);

impl Claim {
    /// Notes which file was opened: what lies at its path from now on should be that one.
    pub fn opened(&self) {
        self.opened.get_or_init(|| std::fs::metadata(&self.path).ok().as_ref().and_then(identity));
    }

    /// Whether the file that was opened, and the lock that says so, are still what lies at their paths. What is written to a file that
    /// was removed is lost with the last who has it open.
    #[must_use]
    pub fn is_there(&self) -> bool {
        let at = |path: &Path| std::fs::metadata(path).ok().as_ref().and_then(identity);
        let locked = self.lock.metadata().ok().as_ref().and_then(identity);
        let opened = self.opened.get().copied().flatten();
        locked == at(&self.beside) && opened.is_none_or(|opened| at(&self.path) == Some(opened))
    }
}

/// Which file it is.
fn identity(file: &std::fs::Metadata) -> Option<Identity> {
    #[cfg(unix)]
    return Some((std::os::unix::fs::MetadataExt::dev(file), std::os::unix::fs::MetadataExt::ino(file)));
    #[cfg(not(unix))]
    {
        let _ = file;
        None
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        // Closing is not enough: a child that is being spawned elsewhere in this process holds a copy of the file until
        // it has started its own program. What cannot be unlocked is unlocked by the system when the last copy closes.
        let _ = self.lock.unlock();
    }
}

/// Claims a database for this process.
///
/// # Errors
/// `Locked` where another server has it; a folder that cannot be written.
pub fn claim(path: &Path) -> Result<Claim, OpenError> {
    let name = path.display().to_string();
    if no_file(path) {
        return Err(OpenError::NoFile(name));
    }
    if names(path) > 1 {
        return Err(OpenError::Linked(name));
    }
    // By whatever link it is reached, it is one database; one that is yet to be made has its own path.
    let path = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let mut beside = path.clone().into_os_string();
    beside.push(".lock");
    let beside = PathBuf::from(beside);
    let lock = std::fs::File::create(&beside).map_err(|error| match error.kind() {
        std::io::ErrorKind::PermissionDenied | std::io::ErrorKind::ReadOnlyFilesystem => {
            OpenError::ReadOnly(name.clone())
        }
        std::io::ErrorKind::NotFound => OpenError::NoFolder(name.clone()),
        _ => OpenError::Other { path: name.clone(), reason: error.to_string() },
    })?;
    match lock.try_lock() {
        Ok(()) => Ok(Claim { lock, beside, path, opened: OnceLock::new() }),
        Err(std::fs::TryLockError::WouldBlock) => Err(OpenError::Locked(name)),
        Err(std::fs::TryLockError::Error(error)) => {
            Err(OpenError::Other { path: name, reason: error.to_string() })
        }
    }
}

/// Whether there is something that is no file.
pub(super) fn no_file(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|there| !there.is_file())
}

/// How many names a file has.
fn names(path: &Path) -> u64 {
    #[cfg(unix)]
    return std::fs::metadata(path).map_or(1, |there| std::os::unix::fs::MetadataExt::nlink(&there));
    #[cfg(not(unix))]
    1
}

#[cfg(all(test, unix))]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::super::OpenError;
    use super::claim;

    #[test]
    fn a_database_is_claimed_once_by_whatever_link_it_is_reached() {
        let folder = tempfile::tempdir().expect("a folder");
        let (db, link) = (folder.path().join("db"), folder.path().join("link"));
        std::fs::write(&db, "").expect("a file");
        std::os::unix::fs::symlink("db", &link).expect("a link");
        let first = claim(&link).expect("nobody has it");
        assert!(claim(&db).is_err() && claim(&link).is_err());
        drop(first);
        assert!(claim(&db).is_ok());
        let other = folder.path().join("other");
        std::fs::hard_link(&db, &other).expect("a second name");
        assert!(matches!(claim(&db), Err(OpenError::Linked(_))));
        std::fs::remove_file(other).expect("it is there");
        assert!(claim(&db).is_ok());
        assert!(matches!(claim(folder.path()), Err(OpenError::NoFile(_))));
    }

    #[test]
    fn what_was_removed_or_replaced_is_not_there() {
        let folder = tempfile::tempdir().expect("a folder");
        let [db, aside, lock] = ["db", "aside", "db.lock"].map(|name| folder.path().join(name));
        std::fs::write(&db, "").expect("a file");
        let claim = claim(&db).expect("nobody has it");
        claim.opened();
        assert!(claim.is_there());
        std::fs::rename(&db, &aside).expect("it is there");
        assert!(!claim.is_there());
        std::fs::write(&db, "").expect("another file");
        assert!(!claim.is_there());
        std::fs::rename(&aside, &db).expect("it is there");
        assert!(claim.is_there());
        std::fs::remove_file(&lock).expect("it is there");
        assert!(!claim.is_there());
    }

    #[test]
    fn a_claim_that_is_let_go_can_be_taken_while_children_are_spawned() {
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
            let refused = (0..20_000).filter(|_| claim(&db).is_err()).count();
            done.store(true, Ordering::Relaxed);
            assert_eq!(refused, 0);
        });
    }
}
