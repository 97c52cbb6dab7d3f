//! A copy of the database as it was, before it is brought to a newer schema.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use sqlx::SqliteConnection;

/// Where the copy of a database of this schema goes: beside it.
fn place(path: &Path, schema: i64) -> PathBuf {
    let mut beside: OsString = path.as_os_str().to_owned();
    beside.push(format!(".schema-{schema}"));
    beside.into()
}

/// The schema of a database; none of one that is new.
pub(super) async fn schema(connection: &mut SqliteConnection) -> Result<Option<i64>, sqlx::Error> {
    let known: i64 = sqlx::query_scalar(
        "SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name = '_sqlx_migrations'",
    )
    .fetch_one(&mut *connection)
    .await?;
    if known == 0 {
        return Ok(None);
    }
    sqlx::query_scalar("SELECT max(version) FROM _sqlx_migrations").fetch_one(connection).await
}

/// Copies the database, whole or not at all; where to.
///
/// # Errors
/// Why it could not: no room, mostly.
pub(super) async fn back_up(
    connection: &mut SqliteConnection,
    path: &Path,
    schema: i64,
) -> Result<PathBuf, String> {
    let (copy, mut unfinished) = (place(path, schema), place(path, schema).into_os_string());
    unfinished.push(".unfinished");
    let unfinished = PathBuf::from(unfinished);
    let made = copy_to(connection, &unfinished, &copy).await;
    if made.is_err() {
        // What is not whole is of use to nobody, and may be what fills the disk.
        let _ = std::fs::remove_file(&unfinished);
    }
    made.map(|()| copy)
}

async fn copy_to(connection: &mut SqliteConnection, unfinished: &Path, copy: &Path) -> Result<(), String> {
    let name = unfinished.to_str().ok_or("its path is no text")?;
    match std::fs::remove_file(unfinished) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.to_string()),
        _ => {} // of an attempt that was cut off
    }
    sqlx::query("VACUUM INTO ?").bind(name).execute(connection).await.map_err(|error| error.to_string())?;
    // SQLite does not wait for the disk here (sqlite.org/lang_vacuum.html).
    let synced = std::fs::File::open(unfinished).and_then(|file| file.sync_all());
    synced.and_then(|()| std::fs::rename(unfinished, copy)).map_err(|error| error.to_string())
}
