//! Errors of policy files.

use std::path::PathBuf;

use crate::MAX_FILE_BYTES;
use crate::reference::PolicyFileKind;

/// A policy file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PolicyFileError {
    /// The file cannot be read.
    #[error("{} cannot be read: {source}", file.display())]
    Read {
        /// Path of the file.
        file: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file is too large.
    #[error("{} has {bytes} bytes; a policy file may have at most {MAX_FILE_BYTES}", file.display())]
    TooLarge {
        /// Path of the file.
        file: PathBuf,
        /// Size of the file in bytes.
        bytes: u64,
    },
    /// The file is not a policy of its kind.
    #[error("{} is not {}: {reason}", file.display(), kind.description())]
    Malformed {
        /// Path of the file.
        file: PathBuf,
        /// Kind of policy that was expected.
        kind: PolicyFileKind,
        /// Reason, as a clause.
        reason: String,
    },
    /// The server has no folder with policies.
    #[error("the server has no folder with policy files; start it with --policy-folder FOLDER")]
    NoFolder,
    /// The name contains more than the name of a file in the folder.
    #[error("the policy must be a file in the server's policy folder, such as onnx:model.onnx, got {0:?}")]
    Outside(String),
    /// The file has other contents than the ones that were requested.
    #[error("the file of {requested} has changed: its hash now begins with {found}")]
    Changed {
        /// The policy, with the beginning of the requested hash.
        requested: String,
        /// Beginning of the hash of the file.
        found: String,
    },
}
