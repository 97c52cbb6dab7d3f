//! List of the backups of a database, in a text file beside it: a damaged database cannot say where its backups are.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use super::Millis;

/// Backup of a database that still exists.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Backup {
    /// Path of the copy.
    pub path: PathBuf,
    /// When the copy was written.
    pub at: Millis,
}

/// Adds a backup to the list of a database.
///
/// # Errors
/// Returns an error if the list cannot be written, or if the path of the backup is not one line of text.
pub fn record(database: &Path, backup: &Path) -> std::io::Result<()> {
    let backup = std::fs::canonicalize(backup)?;
    let line = backup.to_str().filter(|path| !path.contains('\n'));
    let line = line.ok_or_else(|| std::io::Error::other("the path of the backup is not one line of text"))?;
    let mut list = std::fs::File::options().append(true).create(true).open(list_path(database))?;
    list.write_all(format!("{line}\n").as_bytes())
}

/// Returns the newest backup of a database that still exists: one in its list, or a copy that was made before a migration.
#[must_use]
pub fn newest(database: &Path) -> Option<Backup> {
    let database = std::fs::canonicalize(database).unwrap_or_else(|_| database.to_owned());
    let listed = std::fs::read_to_string(list_path(&database)).unwrap_or_default();
    let listed = listed.lines().map(PathBuf::from).filter(|path| *path != database);
    let backups = listed.chain(copies_before_migrations(&database)).filter_map(|path| {
        let written = std::fs::metadata(&path).ok().filter(std::fs::Metadata::is_file)?.modified().ok()?;
        let at = i64::try_from(written.duration_since(UNIX_EPOCH).ok()?.as_millis()).ok()?;
        Some(Backup { path, at })
    });
    backups.max_by_key(|backup| backup.at)
}

/// Path of the list of backups.
fn list_path(database: &Path) -> PathBuf {
    let database = std::fs::canonicalize(database).unwrap_or_else(|_| database.to_owned());
    let mut path = database.into_os_string();
    path.push(".backups");
    path.into()
}

/// Copies of older schemas beside the database.
fn copies_before_migrations(database: &Path) -> Vec<PathBuf> {
    let (Some(folder), Some(name)) = (database.parent(), database.file_name().and_then(|name| name.to_str()))
    else {
        return Vec::new();
    };
    let prefix = format!("{name}.schema-");
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let is_copy = |path: &PathBuf| {
        let version =
            path.file_name().and_then(|name| name.to_str()).and_then(|name| name.strip_prefix(&prefix));
        version.is_some_and(|version| version.parse::<u32>().is_ok())
    };
    entries.flatten().map(|entry| entry.path()).filter(is_copy).collect()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn newest_backup_that_exists_is_found() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().canonicalize().expect("the folder exists").join(name);
        let write = |name: &str, age_s: u64| {
            let file = std::fs::File::create(path(name)).expect("a file");
            file.set_modified(UNIX_EPOCH + Duration::from_secs(1_000_000 - age_s)).expect("a time");
        };
        let db = path("db");
        write("db", 0);
        assert_eq!(newest(&db), None);
        write("db.schema-1", 300);
        write("db.schema-1.unfinished", 1);
        let found = || newest(&db).map(|backup| backup.path);
        assert_eq!(found(), Some(path("db.schema-1")));
        for (name, age_s) in [("a", 200), ("b", 100)] {
            write(name, age_s);
            record(&db, &path(name)).expect("the list is writable");
        }
        assert_eq!(found(), Some(path("b")));
        std::fs::remove_file(path("b")).expect("the file exists");
        assert_eq!(found(), Some(path("a")));
    }
}
