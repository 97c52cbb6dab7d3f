//! Copies of a database: before it is brought to a newer schema, and whenever somebody asks for one.

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

/// Copies the database beside it; where to.
///
/// # Errors
/// Why it could not: no room, mostly.
pub(super) async fn back_up(
    connection: &mut SqliteConnection,
    path: &Path,
    schema: i64,
) -> Result<PathBuf, String> {
    let to = place(path, schema);
    copy(connection, &to).await.map(|()| to)
}

/// Copies the database as it stands at one moment, whole or not at all, while others use it.
///
/// # Errors
/// Why it could not: no room, mostly.
pub async fn copy(connection: &mut SqliteConnection, to: &Path) -> Result<(), String> {
    let mut unfinished = to.to_path_buf().into_os_string();
    unfinished.push(".unfinished");
    let unfinished = PathBuf::from(unfinished);
    let made = copy_by(connection, &unfinished, to).await;
    if made.is_err() {
        // What is not whole is of use to nobody, and may be what fills the disk.
        for ending in ["", "-journal"] {
            let mut part = unfinished.clone().into_os_string();
            part.push(ending);
            let _ = std::fs::remove_file(part);
        }
    }
    made
}

async fn copy_by(connection: &mut SqliteConnection, unfinished: &Path, to: &Path) -> Result<(), String> {
    let name = unfinished.to_str().ok_or("its path is no text")?;
    match std::fs::remove_file(unfinished) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.to_string()),
        _ => {} // of an attempt that was cut off
    }
    sqlx::query("VACUUM INTO ?").bind(name).execute(connection).await.map_err(|error| error.to_string())?;
    // SQLite does not wait for the disk here (sqlite.org/lang_vacuum.html); a name is on disk when its folder is.
    let folder = to.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let synced = std::fs::File::open(unfinished).and_then(|file| file.sync_all());
    let named = synced.and_then(|()| std::fs::rename(unfinished, to));
    let kept = named.and_then(|()| std::fs::File::open(folder)?.sync_all());
    kept.map_err(|error| error.to_string())
}
