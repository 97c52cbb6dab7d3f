//! Errors of vector sessions.

use env_core::ScenarioError;
use env_core::batch::BatchError;

use super::frame::FrameError;
use crate::engine::error::ServiceError;
use crate::limits::QuotaExceeded;
use crate::sessions::session_request::SessionRequestError;

/// Error of opening a vector session or of a frame.
#[derive(Debug, thiserror::Error)]
pub enum VectorError {
    /// A field of the request is invalid.
    #[error(transparent)]
    Request(#[from] SessionRequestError),
    /// Too many sessions are open.
    #[error(transparent)]
    Quota(#[from] QuotaExceeded),
    /// The environments need more memory than is free.
    #[error(transparent)]
    Memory(#[from] MemoryExceeded),
    /// The bytes are not a frame of this session.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The frame's number is neither the last one nor the next one.
    #[error("must be {} for a new frame, or {last} to repeat the last reply, got {found}", .last.wrapping_add(1))]
    Sequence {
        /// Number of the frame.
        found: u32,
        /// Number of the last frame that was answered.
        last: u32,
    },
    /// The environments reject the request or the frame.
    #[error(transparent)]
    Batch(#[from] BatchError),
    /// The run, its lease or the store rejects the request.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The environments panicked and are gone.
    #[error("the environments were lost; the server's log has the reason")]
    Lost,
}

impl From<ScenarioError> for VectorError {
    fn from(source: ScenarioError) -> Self {
        Self::Batch(BatchError::Scenario { env: 0, source })
    }
}

/// Error of environments that need more memory than vector sessions have left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the environments need {needed_mib} MiB of memory, but {free_mib} of {limit_mib} MiB are free; open fewer environments"
)]
pub struct MemoryExceeded {
    /// Memory that the environments need, in MiB.
    pub needed_mib: usize,
    /// Memory that is free, in MiB.
    pub free_mib: usize,
    /// Memory of all vector sessions, in MiB.
    pub limit_mib: usize,
}

impl MemoryExceeded {
    /// Returns true if the environments would not fit into an idle server either.
    #[must_use]
    pub const fn is_permanent(&self) -> bool {
        self.needed_mib > self.limit_mib
    }
}
