//! Opening the database: one file, WAL, one writer, many readers.

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::OnceLock;
use std::time::Duration;

use sqlx::migrate::{MigrateError, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{ConnectOptions, Connection, SqliteConnection, SqlitePool};

use super::backup::{back_up, schema};
use super::primary_code;

static MIGRATIONS: Migrator = sqlx::migrate!("../migrations");

/// How long one statement waits for another process's lock.
const BUSY_TIMEOUT: Duration = Duration::from_secs(5);
/// Connections that read.
const READERS: u32 = 4;
/// Pages that are kept in memory: of the writer 64 MiB, of a reader 8 (negative: KiB).
const CACHES: [&str; 2] = ["-65536", "-8192"];
/// Pages of the write-ahead log from which on the writer folds it in by itself, and waits for that: 32 MiB. It comes to that
/// only where [`fold`] falls behind, and finds little left to do.
const LOG_PAGES: &str = "8192";

/// A database that cannot be opened, each with what to do.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Not a database.
    #[error("{0} is not an SQLite database: give another path with --db, or move the file away")]
    NotADatabase(String),
    /// A database of which pages are torn.
    #[error(
        "{0} is damaged: pages of it are torn; if it was just put there, remove {0}-wal and {0}-shm, which are of what was there before; else go back to a copy, as `sparring db backup` makes them"
    )]
    Damaged(String),
    /// Another application's database.
    #[error("{0} is a database, but not one of Sparring's: give another path with --db")]
    Foreign(String),
    /// Written by a newer version.
    #[error(
        "{path} was written by a newer Sparring (schema {found}, this one knows {known}): upgrade Sparring, or give another path with --db"
    )]
    Newer {
        /// The file.
        path: String,
        /// Schema found.
        found: i64,
        /// Newest schema known.
        known: i64,
    },
    /// Written by an older version, where it is not to be changed.
    #[error(
        "{path} was written by an older Sparring (schema {found}, this one has {known}): start `sparring serve` on it once, which copies it and brings it on"
    )]
    Older {
        /// The file.
        path: String,
        /// Schema found.
        found: i64,
        /// This program's.
        known: i64,
    },
    /// No permission to write.
    #[error("{0} cannot be written: check the permissions of the file and its folder")]
    ReadOnly(String),
    /// Another process holds it.
    #[error("{0} is locked by another process: stop the other server, or give another path with --db")]
    Locked(String),
    /// Reached by several names, each of which would have a log of its own (sqlite.org/howtocorrupt.html).
    #[error(
        "{0} has another name (it is hard-linked), and a database of two names is lost where both are used: copy it by `sparring db backup`, or remove the other name"
    )]
    Linked(String),
    /// A folder, or a device.
    #[error("{0} is no file: give the path of a file, which need not be there yet, with --db")]
    NoFile(String),
    /// No room.
    #[error("{0}: the disk is full, or the file may not grow; make room and try again")]
    Full(String),
    /// Nowhere to put it.
    #[error("{0} cannot be opened: the file or its folder does not exist or may not be opened")]
    NoFolder(String),
    /// No copy could be made before it is changed.
    #[error(
        "{path} has an older schema ({schema}), and a copy of it could not be made before it is changed: {reason}; make room beside it, or move it"
    )]
    NoCopy {
        /// The file.
        path: String,
        /// Its schema.
        schema: i64,
        /// Why.
        reason: String,
    },
    /// Anything else.
    #[error("{path} cannot be opened: {reason}")]
    Other {
        /// The file.
        path: String,
        /// Why.
        reason: String,
    },
}

fn options(path: &Path) -> Result<SqliteConnectOptions, OpenError> {
    let name = path.display().to_string();
    // A path is not a URL: no character of it means anything.
    SqliteConnectOptions::from_str("sqlite::memory:")
        .map(|options| {
            options
                .in_memory(false)
                .shared_cache(false)
                .filename(path)
                .journal_mode(SqliteJournalMode::Wal)
                .synchronous(SqliteSynchronous::Full)
                .foreign_keys(true)
                .busy_timeout(BUSY_TIMEOUT)
                .pragma("trusted_schema", "OFF")
                .disable_statement_logging()
        })
        .map_err(|error| OpenError::Other { path: name, reason: error.to_string() })
}

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
fn no_file(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|there| !there.is_file())
}

/// Whether it is another application's database, found without changing it: ours keep a write-ahead log, and to open one that
/// does not as ours are opened would make it keep one.
async fn foreign_as_it_lies(path: &Path) -> Result<bool, OpenError> {
    let rollback = {
        let mut head = [0; 20];
        let read =
            std::fs::File::open(path).and_then(|mut file| std::io::Read::read_exact(&mut file, &mut head));
        // Bytes 18 and 19 are 1 without such a log, 2 with one (sqlite.org/fileformat2.html, 1.3).
        read.is_ok() && head.starts_with(b"SQLite format 3\0") && head.ends_with(&[1, 1])
    };
    if !rollback {
        return Ok(false);
    }
    let name = path.display().to_string();
    let fault = |error: &sqlx::Error| explain(&name, error);
    let options = SqliteConnectOptions::new().filename(path).read_only(true).disable_statement_logging();
    let mut connection = SqliteConnection::connect_with(&options).await.map_err(|error| fault(&error))?;
    let foreign = foreign(&mut connection).await.map_err(|error| fault(&error))?;
    connection.close().await.map_err(|error| fault(&error))?;
    Ok(foreign)
}

/// How many names a file has.
fn names(path: &Path) -> u64 {
    #[cfg(unix)]
    return std::fs::metadata(path).map_or(1, |there| std::os::unix::fs::MetadataExt::nlink(&there));
    #[cfg(not(unix))]
    1
}

/// Opens, creating and migrating where needed. One of an older schema is copied before it is changed.
///
/// # Errors
/// A file that is no database, another's, newer, read-only or locked.
pub async fn writer(path: &Path) -> Result<SqliteConnection, OpenError> {
    let name = path.display().to_string();
    let fault = |error: &sqlx::Error| explain(&name, error);
    if foreign_as_it_lies(path).await? {
        return Err(OpenError::Foreign(name));
    }
    let options = options(path)?
        .create_if_missing(true)
        .pragma("cache_size", CACHES[0])
        .pragma("wal_autocheckpoint", LOG_PAGES);
    let mut connection = SqliteConnection::connect_with(&options).await.map_err(|error| fault(&error))?;
    if foreign(&mut connection).await.map_err(|error| fault(&error))? {
        return Err(OpenError::Foreign(name));
    }
    let stored = schema(&mut connection).await.map_err(|error| fault(&error))?;
    if let Some(schema) = stored.filter(|stored| *stored < newest()) {
        let copy = back_up(&mut connection, path, schema).await.map_err(|reason| OpenError::NoCopy {
            path: name.clone(),
            schema,
            reason,
        })?;
        tracing::info!(
            from = schema, to = newest(), copy = %copy.display(),
            "The database is brought to a newer schema; as it was it is kept beside it, for as long as you like."
        );
    }
    MIGRATIONS.run(&mut connection).await.map_err(|error| match error {
        MigrateError::VersionMissing(found) => {
            OpenError::Newer { path: name.clone(), found, known: newest() }
        }
        MigrateError::Execute(error) => explain(&name, &error),
        other => OpenError::Other { path: name.clone(), reason: other.to_string() },
    })?;
    // Migrations that are up to date write nothing: make sure now, not at the first result, that writing works.
    sqlx::query("BEGIN IMMEDIATE").execute(&mut connection).await.map_err(|error| fault(&error))?;
    sqlx::query("ROLLBACK").execute(&mut connection).await.map_err(|error| fault(&error))?;
    Ok(connection)
}

/// Connections that only read.
///
/// # Errors
/// A file that cannot be opened.
pub async fn reader(path: &Path) -> Result<SqlitePool, OpenError> {
    readers(path, options(path)?).await
}

async fn readers(path: &Path, options: SqliteConnectOptions) -> Result<SqlitePool, OpenError> {
    SqlitePoolOptions::new()
        .max_connections(READERS)
        .test_before_acquire(false) // a file does not go away, and asking is a turn of two threads
        .connect_with(options.pragma("query_only", "ON").pragma("cache_size", CACHES[1]))
        .await
        .map_err(|error| explain(&path.display().to_string(), &error))
}

/// The same of one that lies where nothing can be written, as a copy on a medium that is read-only: nobody can be changing it.
async fn reader_of_still(path: &Path) -> Result<SqlitePool, OpenError> {
    match reader(path).await {
        Err(OpenError::NoFolder(_) | OpenError::ReadOnly(_)) if path.is_file() && !has_log(path) => {
            let still = options(path)?.read_only(true).immutable(true);
            readers(path, still.journal_mode(SqliteJournalMode::Off)).await
        }
        opened => opened,
    }
}

/// Whether there is a write-ahead log beside it, with what is not in the file yet.
fn has_log(path: &Path) -> bool {
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    std::fs::metadata(log).is_ok_and(|log| log.len() > 0)
}

/// Connections that only read a database of this program's schema, which a server may use meanwhile.
///
/// # Errors
/// A file that cannot be opened, is none of Sparring's, or of another schema.
pub async fn reader_of_current(path: &Path) -> Result<SqlitePool, OpenError> {
    let name = path.display().to_string();
    let fault = |error: &sqlx::Error| explain(&name, error);
    if no_file(path) {
        return Err(OpenError::NoFile(name));
    }
    if foreign_as_it_lies(path).await? {
        return Err(OpenError::Foreign(name));
    }
    let readers = reader_of_still(path).await?;
    let mut connection = readers.acquire().await.map_err(|error| fault(&error))?;
    if foreign(&mut connection).await.map_err(|error| fault(&error))? {
        return Err(OpenError::Foreign(name));
    }
    let known = newest();
    match schema(&mut connection).await.map_err(|error| fault(&error))? {
        Some(found) if found > known => Err(OpenError::Newer { path: name, found, known }),
        Some(found) if found < known => Err(OpenError::Older { path: name, found, known }),
        Some(_) => Ok(readers),
        None => Err(OpenError::Foreign(name)),
    }
}

/// Gives free room in the file back to the disk. Whoever calls this holds the [`Claim`].
///
/// # Errors
/// A file that cannot be opened, a disk that is full.
pub async fn vacuum(path: &Path) -> Result<(), OpenError> {
    let name = path.display().to_string();
    let fault = |error: &sqlx::Error| explain(&name, error);
    let mut connection =
        SqliteConnection::connect_with(&options(path)?).await.map_err(|error| fault(&error))?;
    for statement in ["VACUUM", "PRAGMA wal_checkpoint(TRUNCATE)"] {
        sqlx::query(statement).execute(&mut connection).await.map_err(|error| fault(&error))?;
    }
    connection.close().await.map_err(|error| fault(&error))
}

/// A connection for [`fold`], and for copies.
///
/// # Errors
/// A file that cannot be opened.
pub async fn folder(path: &Path) -> Result<SqliteConnection, OpenError> {
    let opened = SqliteConnection::connect_with(&options(path)?).await;
    opened.map_err(|error| explain(&path.display().to_string(), &error))
}

/// Folds as much of the write-ahead log into the database as can be without making anybody wait.
///
/// # Errors
/// The database's.
pub async fn fold(connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
    sqlx::query("PRAGMA wal_checkpoint(PASSIVE)").execute(connection).await.map(drop)
}

/// Tables, but not ours.
async fn foreign(connection: &mut SqliteConnection) -> Result<bool, sqlx::Error> {
    let tables: i64 = sqlx::query_scalar("SELECT count(*) FROM sqlite_schema WHERE type = 'table'")
        .fetch_one(&mut *connection)
        .await?;
    let ours: i64 = sqlx::query_scalar(
        "SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name = '_sqlx_migrations'",
    )
    .fetch_one(connection)
    .await?;
    Ok(tables > 0 && ours == 0)
}

fn newest() -> i64 {
    MIGRATIONS.iter().map(|migration| migration.version).max().unwrap_or(0)
}

fn explain(name: &str, error: &sqlx::Error) -> OpenError {
    match primary_code(error) {
        Some(26) => OpenError::NotADatabase(name.to_owned()),
        Some(11) => OpenError::Damaged(name.to_owned()),
        Some(8) => OpenError::ReadOnly(name.to_owned()),
        Some(5 | 6) => OpenError::Locked(name.to_owned()),
        Some(14) => OpenError::NoFolder(name.to_owned()),
        Some(13) => OpenError::Full(name.to_owned()),
        _ => OpenError::Other { path: name.to_owned(), reason: error.to_string() },
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::{OpenError, claim};

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
