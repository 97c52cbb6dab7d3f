//! Opening a database: one file with a write-ahead log, one writer, several readers.

use std::path::Path;
use std::str::FromStr;
use std::time::Duration;

use sqlx::migrate::{MigrateError, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{ConnectOptions, Connection, SqliteConnection, SqlitePool};

use super::backup::{back_up, schema_version};
use super::open_error::{OpenError, is_no_file};

/// Schema of this program.
static MIGRATIONS: Migrator = sqlx::migrate!("../migrations");

/// Longest time that a statement waits for another process's lock.
const BUSY_TIMEOUT: Duration = Duration::from_secs(5);
/// Connections of a pool of readers.
const READERS: u32 = 4;
/// Longest time that a query waits for a connection of the pool.
const READER_TIMEOUT: Duration = Duration::from_secs(10);
/// Page cache of the writer: 64 MiB (a negative number is in KiB).
const WRITER_CACHE: &str = "-65536";
/// Page cache of a reader: 8 MiB (a negative number is in KiB).
const READER_CACHE: &str = "-8192";
/// Pages of the write-ahead log from which on the writer checkpoints by itself, and waits for that: 32 MiB. The log grows to
/// this size only if [`checkpoint`] falls behind, and little is left to do then.
const AUTOCHECKPOINT_PAGES: &str = "8192";

/// Opens the writing connection. Creates and migrates the database if needed; it is copied before a migration.
///
/// # Errors
/// Returns the [`OpenError`] that says what is wrong with the file.
pub async fn open_writer(path: &Path) -> Result<SqliteConnection, OpenError> {
    open_writer_with(path, &MIGRATIONS).await
}

/// Opens the writing connection of a database, and migrates it to the schema of these migrations.
pub(super) async fn open_writer_with(
    path: &Path,
    migrations: &Migrator,
) -> Result<SqliteConnection, OpenError> {
    let fault = |error: sqlx::Error| OpenError::from_sqlx(path, &error);
    if is_foreign_rollback_database(path).await? {
        return Err(OpenError::Foreign(path.display().to_string()));
    }
    let options = options(path)?
        .create_if_missing(true)
        .pragma("cache_size", WRITER_CACHE)
        .pragma("wal_autocheckpoint", AUTOCHECKPOINT_PAGES);
    let mut connection = SqliteConnection::connect_with(&options).await.map_err(fault)?;
    if is_foreign(&mut connection).await.map_err(fault)? {
        return Err(OpenError::Foreign(path.display().to_string()));
    }
    migrate(&mut connection, path, migrations).await?;
    // An up-to-date migration writes nothing. Fail now, not at the first result, if the file cannot be written.
    sqlx::query("BEGIN IMMEDIATE").execute(&mut connection).await.map_err(fault)?;
    sqlx::query("ROLLBACK").execute(&mut connection).await.map_err(fault)?;
    Ok(connection)
}

/// Opens connections that only read.
///
/// # Errors
/// Returns the [`OpenError`] that says why the file cannot be opened.
pub async fn open_readers(path: &Path) -> Result<SqlitePool, OpenError> {
    connect_readers(path, options(path)?).await
}

/// Opens connections that only read, if the database has this program's schema. A server may use the database meanwhile.
///
/// # Errors
/// Returns [`OpenError::Older`] or [`OpenError::Newer`] for another schema, [`OpenError::Foreign`] for the database of another
/// application, or the [`OpenError`] that says why the file cannot be opened.
pub async fn open_current_readers(path: &Path) -> Result<SqlitePool, OpenError> {
    open_current_readers_with(path, &MIGRATIONS).await
}

/// Opens connections that only read, if the database has the schema of these migrations.
pub(super) async fn open_current_readers_with(
    path: &Path,
    migrations: &Migrator,
) -> Result<SqlitePool, OpenError> {
    let name = path.display().to_string();
    let fault = |error: sqlx::Error| OpenError::from_sqlx(path, &error);
    if is_no_file(path) {
        return Err(OpenError::NoFile(name));
    }
    if is_foreign_rollback_database(path).await? {
        return Err(OpenError::Foreign(name));
    }
    let readers = open_readers_on_any_medium(path).await?;
    let mut connection = readers.acquire().await.map_err(fault)?;
    if is_foreign(&mut connection).await.map_err(fault)? {
        return Err(OpenError::Foreign(name));
    }
    let known = newest_schema(migrations);
    match schema_version(&mut connection).await.map_err(fault)? {
        Some(found) if found > known => Err(OpenError::Newer { path: name, found, known }),
        Some(found) if found < known => Err(OpenError::Older { path: name, found, known }),
        Some(_) => Ok(readers),
        None => Err(OpenError::Foreign(name)),
    }
}

/// Opens a connection for [`checkpoint`] and for copies.
///
/// # Errors
/// Returns the [`OpenError`] that says why the file cannot be opened.
pub async fn open_maintenance(path: &Path) -> Result<SqliteConnection, OpenError> {
    let opened = SqliteConnection::connect_with(&options(path)?).await;
    opened.map_err(|error| OpenError::from_sqlx(path, &error))
}

/// Moves as much of the write-ahead log into the database as is possible without blocking readers or the writer.
///
/// # Errors
/// Returns SQLite's error.
pub async fn checkpoint(connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
    sqlx::query("PRAGMA wal_checkpoint(PASSIVE)").execute(connection).await.map(drop)
}

/// Returns free space in the file to the disk. The caller must hold the [`DatabaseLock`](super::DatabaseLock).
///
/// # Errors
/// Returns the [`OpenError`] that says why the file cannot be opened or rewritten, for example [`OpenError::Full`].
pub async fn vacuum(path: &Path) -> Result<(), OpenError> {
    let fault = |error: sqlx::Error| OpenError::from_sqlx(path, &error);
    let mut connection = SqliteConnection::connect_with(&options(path)?).await.map_err(fault)?;
    for statement in ["VACUUM", "PRAGMA wal_checkpoint(TRUNCATE)"] {
        sqlx::query(statement).execute(&mut connection).await.map_err(fault)?;
    }
    connection.close().await.map_err(fault)
}

/// Migrates a database to the newest schema, after a copy of it was made.
async fn migrate(
    connection: &mut SqliteConnection,
    path: &Path,
    migrations: &Migrator,
) -> Result<(), OpenError> {
    let name = path.display().to_string();
    let known = newest_schema(migrations);
    let stored = schema_version(connection).await.map_err(|error| OpenError::from_sqlx(path, &error))?;
    if let Some(schema) = stored.filter(|stored| *stored < known) {
        let copy = back_up(connection, path, schema).await.map_err(|reason| OpenError::NoCopy {
            path: name.clone(),
            schema,
            reason,
        })?;
        tracing::info!(
            from = schema, to = known, copy = %copy.display(),
            "The database is migrated to a newer schema; its folder keeps a copy of the old one."
        );
    }
    migrations.run(connection).await.map_err(|error| match error {
        MigrateError::VersionMissing(found) => OpenError::Newer { path: name, found, known },
        MigrateError::Execute(error) => OpenError::from_sqlx(path, &error),
        other => OpenError::Other { path: name, reason: other.to_string() },
    })
}

/// Schema version that these migrations lead to.
fn newest_schema(migrations: &Migrator) -> i64 {
    migrations.iter().map(|migration| migration.version).max().unwrap_or(0)
}

fn options(path: &Path) -> Result<SqliteConnectOptions, OpenError> {
    // The path is set as a file name: as part of a URL, some of its characters would have a meaning.
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
        .map_err(|error| OpenError::Other { path: path.display().to_string(), reason: error.to_string() })
}

async fn connect_readers(path: &Path, options: SqliteConnectOptions) -> Result<SqlitePool, OpenError> {
    let fault = |error: sqlx::Error| OpenError::from_sqlx(path, &error);
    let readers = SqlitePoolOptions::new()
        // All are opened now and stay open: one that is opened after the file was replaced would use another file together with
        // the write-ahead log of this one, and could delete that log (sqlite.org/howtocorrupt.html, 1.4).
        .min_connections(READERS)
        .max_connections(READERS)
        .idle_timeout(None)
        .max_lifetime(None)
        .acquire_timeout(READER_TIMEOUT)
        .test_before_acquire(false) // a file does not disconnect, and the test is a round trip between two threads
        .connect_with(options.pragma("query_only", "ON").pragma("cache_size", READER_CACHE))
        .await
        .map_err(fault)?;
    // A task of the pool opens some of them, which may not have ended yet.
    let mut opened = Vec::new();
    for _ in 0..READERS {
        opened.push(readers.acquire().await.map_err(fault)?);
    }
    drop(opened);
    Ok(readers)
}

/// Opens readers also on a medium that cannot be written, for example a read-only copy. Nothing can change it.
async fn open_readers_on_any_medium(path: &Path) -> Result<SqlitePool, OpenError> {
    match open_readers(path).await {
        Err(OpenError::CannotOpen(_) | OpenError::ReadOnly(_)) if path.is_file() && !has_log(path) => {
            let immutable = options(path)?.read_only(true).immutable(true);
            connect_readers(path, immutable.journal_mode(SqliteJournalMode::Off)).await
        }
        opened => opened,
    }
}

/// True if there is a write-ahead log beside the database that holds data.
fn has_log(path: &Path) -> bool {
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    std::fs::metadata(log).is_ok_and(|log| log.len() > 0)
}

/// True if the database belongs to another application: it has tables, but none of ours.
async fn is_foreign(connection: &mut SqliteConnection) -> Result<bool, sqlx::Error> {
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

/// True if the database belongs to another application and has no write-ahead log.
///
/// This is checked without changing the file: opening it with [`options`] would give it a write-ahead log.
async fn is_foreign_rollback_database(path: &Path) -> Result<bool, OpenError> {
    let has_rollback_journal = {
        let mut head = [0; 20];
        let read =
            std::fs::File::open(path).and_then(|mut file| std::io::Read::read_exact(&mut file, &mut head));
        // Bytes 18 and 19 are 1 for a rollback journal, and 2 for a write-ahead log (sqlite.org/fileformat2.html, 1.3).
        read.is_ok() && head.starts_with(b"SQLite format 3\0") && head.ends_with(&[1, 1])
    };
    if !has_rollback_journal {
        return Ok(false);
    }
    let fault = |error: sqlx::Error| OpenError::from_sqlx(path, &error);
    let options = SqliteConnectOptions::new().filename(path).read_only(true).disable_statement_logging();
    let mut connection = SqliteConnection::connect_with(&options).await.map_err(fault)?;
    let foreign = is_foreign(&mut connection).await.map_err(fault)?;
    connection.close().await.map_err(fault)?;
    Ok(foreign)
}
