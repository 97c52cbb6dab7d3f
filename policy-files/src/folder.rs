//! The folder of policy files that a server offers.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use env_core::policy_factory::{BuiltInPolicy, PolicyFactory};

use crate::error::PolicyFileError;
use crate::reference::{PolicyFileKind, PolicyReference};
use crate::{check_hash, open_bytes, read_file};

/// Maximum number of parsed files that are kept.
const MAX_CACHED: usize = 16;

/// Folder of policy files, if the server has one. Clients name files in it, and cannot reach others.
///
/// Parsed files are kept until their time or size changes. Clones share them.
#[derive(Clone, Default)]
pub struct PolicyFolder {
    path: Option<PathBuf>,
    parsed: Arc<Mutex<HashMap<PolicyReference, ParsedFile>>>,
}

/// Parsed file, with the state of the file at that time.
#[derive(Clone)]
struct ParsedFile {
    modified: Option<SystemTime>,
    bytes: u64,
    /// Beginning of the hash of the file.
    hash: String,
    factory: Arc<dyn PolicyFactory>,
}

impl std::fmt::Debug for PolicyFolder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("PolicyFolder").field(&self.path).finish()
    }
}

impl PolicyFolder {
    /// Creates the folder of files in `path`. Files are read when they are first used.
    #[must_use]
    pub fn new(path: PathBuf) -> Self {
        Self { path: Some(path), parsed: Arc::default() }
    }

    /// Returns true if there is a folder.
    #[must_use]
    pub const fn is_configured(&self) -> bool {
        self.path.is_some()
    }

    /// Opens a policy: a built-in one, or a file of the folder.
    ///
    /// # Errors
    /// Returns [`PolicyFileError`] if the name is not that of a file in the folder, the file is not a policy, or it has another hash
    /// than the reference.
    pub fn open(&self, reference: &PolicyReference) -> Result<Arc<dyn PolicyFactory>, PolicyFileError> {
        self.parsed(reference).map(|parsed| parsed.factory)
    }

    /// Returns the reference with the beginning of the file's hash, which names the contents of the file for ever.
    ///
    /// # Errors
    /// As [`PolicyFolder::open`].
    pub fn pin(&self, reference: &PolicyReference) -> Result<PolicyReference, PolicyFileError> {
        Ok(match reference {
            PolicyReference::BuiltIn(_) => reference.clone(),
            PolicyReference::File { kind, file, .. } => {
                let hash = Some(self.parsed(reference)?.hash);
                PolicyReference::File { kind: *kind, file: file.clone(), hash }
            }
        })
    }

    fn parsed(&self, reference: &PolicyReference) -> Result<ParsedFile, PolicyFileError> {
        let (kind, file, hash) = match reference {
            PolicyReference::BuiltIn(name) => {
                let factory = Arc::new(BuiltInPolicy(name.clone()));
                return Ok(ParsedFile { modified: None, bytes: 0, hash: String::new(), factory });
            }
            PolicyReference::File { kind, file, hash } => (*kind, file, hash),
        };
        if !is_file_name(file) {
            return Err(PolicyFileError::Outside(reference.to_string()));
        }
        let parsed = self.parse(kind, file)?;
        check_hash(reference, hash.as_deref(), &parsed.hash)?;
        Ok(parsed)
    }

    /// Parses a file, unless it is unchanged since it was parsed last.
    fn parse(&self, kind: PolicyFileKind, file: &str) -> Result<ParsedFile, PolicyFileError> {
        let path = self.path.as_ref().ok_or(PolicyFileError::NoFolder)?.join(file);
        let now = std::fs::metadata(&path)
            .map_err(|source| PolicyFileError::Read { file: PathBuf::from(file), source })?;
        let key = PolicyReference::File { kind, file: file.to_owned(), hash: None };
        let lock = || self.parsed.lock().unwrap_or_else(PoisonError::into_inner);
        let known = lock().get(&key).cloned();
        let is_same =
            |parsed: &ParsedFile| parsed.bytes == now.len() && parsed.modified == now.modified().ok();
        if let Some(parsed) = known.filter(is_same) {
            return Ok(parsed);
        }
        // Errors name the file, not the server's folder.
        let contents = read_file(&path).map_err(|error| without_folder(error, file))?;
        let factory = open_bytes(kind, key.to_string(), Path::new(file), &contents)?;
        let hash = contents.short_hash().to_owned();
        let parsed = ParsedFile { modified: now.modified().ok(), bytes: now.len(), hash, factory };
        let mut all = lock();
        if all.len() >= MAX_CACHED {
            all.clear();
        }
        all.insert(key, parsed.clone());
        Ok(parsed)
    }
}

/// Replaces the path of an error by the name of the file.
fn without_folder(error: PolicyFileError, file: &str) -> PolicyFileError {
    match error {
        PolicyFileError::Read { source, .. } => PolicyFileError::Read { file: PathBuf::from(file), source },
        PolicyFileError::TooLarge { bytes, .. } => {
            PolicyFileError::TooLarge { file: PathBuf::from(file), bytes }
        }
        other => other,
    }
}

/// True if a text is a name that can only be that of a file in a folder: letters, digits, `_`, `-` and `.`, without a leading dot.
fn is_file_name(text: &str) -> bool {
    let is_valid = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
    !text.is_empty() && text.len() <= 128 && !text.starts_with('.') && text.chars().all(is_valid)
}
