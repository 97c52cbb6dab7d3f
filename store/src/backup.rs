//! Copies of a database: before a migration, and on request.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use sqlx::SqliteConnection;

/// Copies the database as it is at one moment, while others use it. Either the whole copy exists afterwards, or none.
///
/// # Errors
/// Returns the reason if the copy cannot be made, most often a full disk.
pub async fn copy(connection: &mut SqliteConnection, to: &Path) -> Result<(), String> {
    let mut unfinished = to.to_path_buf().into_os_string();
    unfinished.push(".unfinished");
    let unfinished = PathBuf::from(unfinished);
    let copied = copy_via(connection, &unfinished, to).await;
    if copied.is_err() {
        // An incomplete copy is useless, and it may be what fills the disk.
        for ending in ["", "-journal"] {
            let mut part = unfinished.clone().into_os_string();
            part.push(ending);
            let _ = std::fs::remove_file(part);
        }
    }
    copied
}

/// Copies a database of this schema beside itself and returns the path of the copy.
///
/// # Errors
/// Returns the reason if the copy cannot be made, most often a full disk.
pub(super) async fn back_up(
    connection: &mut SqliteConnection,
    path: &Path,
    schema: i64,
) -> Result<PathBuf, String> {
    let to = backup_path(path, schema);
    copy(connection, &to).await.map(|()| to)
}

/// Reads the schema version of a database; none if the database is new.
pub(super) async fn schema_version(connection: &mut SqliteConnection) -> Result<Option<i64>, sqlx::Error> {
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

/// Path of the copy of a database of this schema: beside the database.
fn backup_path(path: &Path, schema: i64) -> PathBuf {
    let mut beside: OsString = path.as_os_str().to_owned();
    beside.push(format!(".schema-{schema}"));
    beside.into()
}

/// Copies to the path `unfinished`, then renames the copy to `to`.
async fn copy_via(connection: &mut SqliteConnection, unfinished: &Path, to: &Path) -> Result<(), String> {
    let name = unfinished.to_str().ok_or("its path is not valid UTF-8")?;
    match std::fs::remove_file(unfinished) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.to_string()),
        _ => {} // left by an attempt that was interrupted
    }
    sqlx::query("VACUUM INTO ?").bind(name).execute(connection).await.map_err(|error| error.to_string())?;
    // SQLite does not sync this file (sqlite.org/lang_vacuum.html). A name is on disk when its folder is.
    let folder = to.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let synced = std::fs::File::open(unfinished).and_then(|file| file.sync_all());
    let renamed = synced.and_then(|()| std::fs::rename(unfinished, to));
    let kept = renamed.and_then(|()| std::fs::File::open(folder)?.sync_all());
    kept.map_err(|error| error.to_string())
}
