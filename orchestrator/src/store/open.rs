//! Opening the database: one file, WAL, one writer, many readers.

use std::path::Path;
use std::str::FromStr;
use std::time::Duration;

use sqlx::migrate::{MigrateError, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{ConnectOptions, Connection, SqliteConnection, SqlitePool};

use super::backup::{back_up, schema};
use super::claim::no_file;
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
