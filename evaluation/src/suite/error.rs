//! Errors of suites that cannot be used.

use std::path::PathBuf;

use env_core::ScenarioError;

/// Reason why a suite cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SuiteError {
    /// The name is neither a built-in suite nor the path of a file.
    #[error("{requested:?} is neither a built-in suite ({known}) nor a file")]
    Unknown {
        /// Requested name or path.
        requested: String,
        /// Names of the built-in suites.
        known: String,
    },
    /// The file cannot be read.
    #[error("{} cannot be read: {reason}; check the permissions of the file and its folder", path.display())]
    Unreadable {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        reason: std::io::Error,
    },
    /// The file is not a suite.
    #[error("it is not a suite file: {reason}")]
    NotASuite {
        /// Error of the parser.
        reason: String,
    },
    /// The suite has a format that this build cannot read.
    #[error("its format is {found:?}; this build reads {known:?}")]
    Format {
        /// Format of the file.
        found: String,
        /// Format that can be read.
        known: &'static str,
    },
    /// The file's bytes do not match its hash.
    #[error("it was altered: its bytes hash to {found}, but its last line has {stated}")]
    Altered {
        /// Hash of the bytes.
        found: String,
        /// Hash in the last line.
        stated: String,
    },
    /// A scenario is invalid.
    #[error("scenario {index} of {task} level {level}: {source}")]
    Scenario {
        /// Task of the scenario's group.
        task: String,
        /// Level of the scenario's group.
        level: usize,
        /// Index of the scenario in its group.
        index: usize,
        /// Reason why it is invalid.
        source: ScenarioError,
    },
    /// The parts of a scenario contradict each other.
    #[error("scenario {index} of {task} level {level}: {reason}")]
    Contradiction {
        /// Task of the scenario's group.
        task: String,
        /// Level of the scenario's group.
        level: usize,
        /// Index of the scenario in its group.
        index: usize,
        /// Contradiction that was found.
        reason: String,
    },
}

impl SuiteError {
    /// Returns true if the file is a suite, but not the one that was built, or not one that these worlds would build.
    #[must_use]
    pub const fn is_difference(&self) -> bool {
        matches!(self, Self::Altered { .. } | Self::Scenario { .. } | Self::Contradiction { .. })
    }
}
