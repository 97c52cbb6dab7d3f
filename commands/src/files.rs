//! Files that users name on the command line: every error has the path, the fault and a remedy.

use std::io::{Error, ErrorKind};
use std::path::Path;

use anyhow::anyhow;

/// Reads a file.
///
/// # Errors
/// Returns the error of [`read_fault`].
pub fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    std::fs::read(path).map_err(|error| read_fault(path, &error))
}

/// Reads a text file.
///
/// # Errors
/// Returns the error of [`read_fault`], or an error if the file is not UTF-8.
pub fn read_text(path: &Path) -> anyhow::Result<String> {
    String::from_utf8(read(path)?).map_err(|_| anyhow!("{} is not a text file in UTF-8", path.display()))
}

/// Writes a file; an existing one is overwritten.
///
/// # Errors
/// Returns the error of [`write_fault`].
pub fn write(path: &Path, contents: impl AsRef<[u8]>) -> anyhow::Result<()> {
    std::fs::write(path, contents).map_err(|error| write_fault(path, &error))
}

/// Creates a folder and its parents, if they do not exist.
///
/// # Errors
/// Returns the error of [`write_fault`].
pub fn create_folder(path: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(path).map_err(|error| write_fault(path, &error))
}

/// Checks before long work that an output file can be created, by creating and deleting another one in its folder.
///
/// # Errors
/// Returns the error of [`write_fault`].
pub fn check_writable(path: &Path) -> anyhow::Result<()> {
    if path.exists() {
        return Ok(());
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::NamedTempFile::new_in(folder).map(drop).map_err(|error| write_fault(path, &error))
}

/// Returns the error of a file that cannot be read.
pub fn read_fault(path: &Path, error: &Error) -> anyhow::Error {
    let path = path.display();
    match error.kind() {
        ErrorKind::NotFound => anyhow!("{path} does not exist; check the path"),
        ErrorKind::PermissionDenied => {
            anyhow!(
                "{path} cannot be read: permission denied; check the permissions of the file and its folder"
            )
        }
        ErrorKind::IsADirectory => anyhow!("{path} is a folder; name a file"),
        _ => anyhow!("{path} cannot be read: {error}"),
    }
}

/// Returns the error of a file or folder that cannot be written.
pub fn write_fault(path: &Path, error: &Error) -> anyhow::Error {
    let path = path.display();
    match error.kind() {
        ErrorKind::NotFound => {
            anyhow!("{path} cannot be written: its folder does not exist; create the folder first")
        }
        ErrorKind::PermissionDenied => {
            anyhow!("{path} cannot be written: permission denied; choose a folder that you may write to")
        }
        ErrorKind::ReadOnlyFilesystem => {
            anyhow!("{path} cannot be written: the file system is read-only; choose another folder")
        }
        ErrorKind::StorageFull => {
            anyhow!("{path} cannot be written: the disk is full; free some space and retry")
        }
        ErrorKind::IsADirectory => anyhow!("{path} is a folder; name a file"),
        ErrorKind::AlreadyExists | ErrorKind::NotADirectory => {
            anyhow!("{path} cannot be written: a file is in its place; choose another path")
        }
        _ => anyhow!("{path} cannot be written: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_errors_name_path_fault_and_remedy() {
        let path = Path::new("a/b.json");
        let kinds = [
            ErrorKind::NotFound,
            ErrorKind::PermissionDenied,
            ErrorKind::IsADirectory,
            ErrorKind::StorageFull,
            ErrorKind::ReadOnlyFilesystem,
            ErrorKind::NotADirectory,
        ];
        let text = kinds.map(|kind| {
            let error = Error::from(kind);
            format!("{}\n{}", read_fault(path, &error), write_fault(path, &error))
        });
        insta::assert_snapshot!(text.join("\n"));
    }

    #[test]
    fn files_are_read_and_written() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("x/y");
        create_folder(&inner).unwrap();
        let file = inner.join("file");
        write(&file, "text").unwrap();
        assert_eq!(read_text(&file).unwrap(), "text");
        assert!(read_text(&inner).unwrap_err().to_string().ends_with("is a folder; name a file"));
        write(&file, [0xff]).unwrap();
        assert!(read_text(&file).unwrap_err().to_string().ends_with("is not a text file in UTF-8"));
        assert!(
            write(&inner.join("missing/file"), "").unwrap_err().to_string().contains("create the folder")
        );
    }
}
