//! Interface of a queue of jobs.

use std::fmt;

use futures_util::future::BoxFuture;
use jobs::{JobOutput, JobPayload};

use crate::status::QueueStatus;

/// Queue of jobs. Its callers do not know where a job is done: the result is the same.
pub trait JobQueue: fmt::Debug + Send + Sync {
    /// Does a job. Dropping the future cancels the job, as far as it has not begun.
    ///
    /// # Errors
    /// Returns [`JobError`] if the job panics.
    fn run(&self, job: JobPayload) -> BoxFuture<'static, Result<CompletedJob, JobError>>;

    /// Returns the workers of the queue, and whether it is degraded.
    fn status(&self) -> QueueStatus;
}

/// Result of a job.
#[derive(Debug)]
pub struct CompletedJob {
    /// The result, with one entry for each item of the job.
    pub output: JobOutput,
    /// What to acknowledge after the commit.
    pub receipt: Receipt,
}

/// Reason why a job has no result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum JobError {
    /// The computation of the job panicked.
    #[error("the computation panicked")]
    Panicked,
    /// The threads that do jobs have ended, because the process stops.
    #[error("the computation was cancelled")]
    Cancelled,
    /// A result is of another kind than its job.
    #[error("the computation returned another kind of result")]
    OtherKind,
}

/// Acknowledgements that are due after the results are committed. A receipt that is dropped acknowledges nothing: the messages are
/// delivered again, and ignored if the server has forgotten their jobs.
#[derive(Default)]
#[must_use = "results are acknowledged after their commit"]
pub struct Receipt(Vec<Box<dyn FnOnce() + Send>>);

impl Receipt {
    /// A receipt that calls a function when it is acknowledged.
    pub fn new(acknowledge: impl FnOnce() + Send + 'static) -> Self {
        Self(vec![Box::new(acknowledge)])
    }

    /// Adds the acknowledgements of another receipt.
    pub fn merge(&mut self, other: Self) {
        self.0.extend(other.0);
    }

    /// Acknowledges the results: the caller has committed them.
    pub fn acknowledge(self) {
        self.0.into_iter().for_each(|acknowledge| acknowledge());
    }
}

impl fmt::Debug for Receipt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Receipt({})", self.0.len())
    }
}
