//! Why a suite cannot be used.

use std::path::PathBuf;

use env_core::ScenarioError;

/// A suite that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SuiteError {
    /// Neither a committed suite nor a file.
    #[error("{which:?} is neither a built-in suite ({known}) nor a file")]
    Unknown {
        /// What was asked for.
        which: String,
        /// The suites that are built in.
        known: String,
    },
    /// A file that cannot be read.
    #[error("{} cannot be read: {source}", path.display())]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Something else than a suite.
    #[error("it is not a suite file: {reason}")]
    NotASuite {
        /// How that shows.
        reason: String,
    },
    /// A suite of a format this build does not read.
    #[error("its format is {found:?}; this build reads {known:?}")]
    Format {
        /// What the file says.
        found: String,
        /// What is read.
        known: &'static str,
    },
    /// The file is not the one that was built.
    #[error("it was altered: its bytes hash to {found}, but it says {told}")]
    Altered {
        /// The hash of its bytes.
        found: String,
        /// The hash it names.
        told: String,
    },
    /// A scenario that cannot be.
    #[error("scenario {index} of {task} level {level}: {source}")]
    Scenario {
        /// Its task, as the file says.
        task: String,
        /// Its level, as the file says.
        level: usize,
        /// Counted from 0 within task and level.
        index: usize,
        /// Why.
        source: ScenarioError,
    },
    /// A scenario whose parts do not belong together.
    #[error("scenario {index} of {task} level {level}: {reason}")]
    Contradiction {
        /// Its task.
        task: String,
        /// Its level.
        level: usize,
        /// Counted from 0 within task and level.
        index: usize,
        /// What does not fit.
        reason: String,
    },
}

impl SuiteError {
    /// The file is a suite, but not the one that was built, or not by these worlds: a check has failed.
    #[must_use]
    pub const fn is_difference(&self) -> bool {
        matches!(self, Self::Altered { .. } | Self::Scenario { .. } | Self::Contradiction { .. })
    }
}
