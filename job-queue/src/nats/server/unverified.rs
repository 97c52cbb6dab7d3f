//! Results of a worker that were used without being verified. The server recomputes them if the worker is expelled.

use std::sync::Arc;

use jobs::design::DesignJob;
use jobs::envelope::ReplyBody;
use jobs::{JobOutput, JobPayload};

/// Largest number of jobs of a worker that are kept until the next agreement. The next result is verified when they are reached.
pub(super) const MAX_UNVERIFIED: usize = 256;
/// The same for design requests, of which each can have many layouts.
pub(super) const MAX_UNVERIFIED_DESIGNS: usize = 32;
/// Largest size of these jobs, and of these requests, in bytes of their messages.
const MAX_UNVERIFIED_BYTES: usize = 4 << 20;

/// A job whose result was used without being verified.
#[derive(Debug, Clone)]
pub(super) struct UnverifiedJob {
    pub(super) job: Arc<JobPayload>,
    pub(super) output: JobOutput,
    /// Size of the messages with both.
    pub(super) bytes: usize,
}

/// A design request whose layouts were used without being judged again, or not all of them.
#[derive(Debug, Clone)]
pub(super) struct UnverifiedDesign {
    pub(super) job: Arc<DesignJob>,
    /// Layouts as the worker reported them.
    pub(super) body: ReplyBody,
    /// Size of the messages with both.
    pub(super) bytes: usize,
}

/// Results of a worker since the last agreement.
#[derive(Debug, Default)]
pub(super) struct UnverifiedWork {
    /// Jobs since the last result of a job that was verified.
    pub(super) jobs: Vec<UnverifiedJob>,
    /// Design requests since the last layout that was judged again.
    pub(super) designs: Vec<UnverifiedDesign>,
}

impl UnverifiedWork {
    /// True if the next result of a job must be verified.
    pub(super) fn is_full_of_jobs(&self) -> bool {
        let bytes: usize = self.jobs.iter().map(|job| job.bytes).sum();
        self.jobs.len() >= MAX_UNVERIFIED || bytes >= MAX_UNVERIFIED_BYTES
    }

    /// True if a layout of the next design request must be judged again.
    pub(super) fn is_full_of_designs(&self) -> bool {
        let bytes: usize = self.designs.iter().map(|design| design.bytes).sum();
        self.designs.len() >= MAX_UNVERIFIED_DESIGNS || bytes >= MAX_UNVERIFIED_BYTES
    }

    /// Moves the results of another worker to these.
    pub(super) fn append(&mut self, other: &mut Self) {
        self.jobs.append(&mut other.jobs);
        self.designs.append(&mut other.designs);
    }
}
