//! Policies from files: ONNX models ([`OnnxPolicy`]) and trained reflexes ([`ReflexPolicy`]).
//!
//! A file implements [`PolicyFactory`], as a built-in policy does, so that evaluations and rollouts treat both alike. The
//! outputs of ONNX models can differ in their last bits between machines. Scores do not depend on this: they follow from the
//! recorded actions. [`PolicyFolder`] is the folder of files that a server offers. Start reading at [`PolicyReference`].

mod error;
mod folder;
mod onnx;
mod reference;
mod reflex;

use std::path::Path;
use std::sync::Arc;

use env_core::policy_factory::{BuiltInPolicy, PolicyFactory};

pub use self::error::PolicyFileError;
pub use self::folder::PolicyFolder;
pub use self::onnx::OnnxPolicy;
use self::reference::HASH_DIGITS;
pub use self::reference::{PolicyFileKind, PolicyReference};
pub use self::reflex::ReflexPolicy;

/// Largest policy file in bytes.
pub const MAX_FILE_BYTES: u64 = 256 << 20;

/// Contents of a policy file, with their hash.
struct PolicyBytes {
    bytes: Vec<u8>,
    /// BLAKE3 of the bytes, in hexadecimal.
    hash: String,
}

impl PolicyBytes {
    /// Beginning of the hash, as references have it.
    fn short_hash(&self) -> &str {
        self.hash.get(..HASH_DIGITS).unwrap_or_default()
    }
}

/// Checks that a file has the hash of its reference, if the reference has one.
fn check_hash(reference: &PolicyReference, wanted: Option<&str>, found: &str) -> Result<(), PolicyFileError> {
    match wanted {
        Some(wanted) if wanted != found => {
            Err(PolicyFileError::Changed { requested: reference.to_string(), found: found.to_owned() })
        }
        _ => Ok(()),
    }
}

/// Reads a policy file.
fn read_file(path: &Path) -> Result<PolicyBytes, PolicyFileError> {
    let unreadable = |source| PolicyFileError::Read { file: path.to_owned(), source };
    let metadata = std::fs::metadata(path).map_err(unreadable)?;
    // Reading a pipe or a device might never end.
    if !metadata.is_file() {
        let reason = std::io::Error::new(std::io::ErrorKind::InvalidInput, "it is not a regular file");
        return Err(unreadable(reason));
    }
    let bytes = metadata.len();
    if bytes > MAX_FILE_BYTES {
        return Err(PolicyFileError::TooLarge { file: path.to_owned(), bytes });
    }
    let bytes = std::fs::read(path).map_err(unreadable)?;
    let hash = blake3::hash(&bytes).to_hex().to_string();
    Ok(PolicyBytes { bytes, hash })
}

/// Creates the factory of a policy: a built-in one, or the contents of a file at a path of this machine.
///
/// # Errors
/// Returns [`PolicyFileError`] if the file cannot be read, is not a policy, or has another hash than the reference.
pub fn open(reference: &PolicyReference) -> Result<Arc<dyn PolicyFactory>, PolicyFileError> {
    match reference {
        PolicyReference::BuiltIn(name) => Ok(Arc::new(BuiltInPolicy(name.clone()))),
        PolicyReference::File { kind, file, hash } => {
            let path = Path::new(file);
            let contents = read_file(path)?;
            check_hash(reference, hash.as_deref(), contents.short_hash())?;
            open_bytes(*kind, reference.to_string(), path, &contents)
        }
    }
}

/// Creates the factory of a policy from the contents of its file.
fn open_bytes(
    kind: PolicyFileKind,
    name: String,
    path: &Path,
    contents: &PolicyBytes,
) -> Result<Arc<dyn PolicyFactory>, PolicyFileError> {
    let malformed = |reason| PolicyFileError::Malformed { file: path.to_owned(), kind, reason };
    Ok(match kind {
        PolicyFileKind::Onnx => Arc::new(OnnxPolicy::parse(name, &contents.bytes).map_err(malformed)?),
        PolicyFileKind::Reflex => Arc::new(ReflexPolicy::parse(name, &contents.bytes).map_err(malformed)?),
    })
}
