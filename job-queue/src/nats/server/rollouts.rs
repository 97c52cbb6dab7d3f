//! Rollouts by workers. A rollout of a language model is no pure function of its job, so no result is recomputed: the service replays
//! every log.

use std::sync::Arc;

use jobs::JobKind;
use jobs::envelope::JobReply;
use rollout::{RolledOutGroup, RolloutJob, RolloutWireError};

use super::pending::RemoteReply;
use super::{Link, Shared};
use crate::queue::Receipt;

/// Rollouts by the workers of a server.
#[derive(Debug, Clone)]
pub struct RolloutQueue(pub(super) Arc<Shared>);

/// Group that a worker rolled out.
#[derive(Debug)]
pub struct RemoteRollout {
    /// Episodes of the group.
    pub group: RolledOutGroup,
    /// Receipt to acknowledge after the commit.
    pub receipt: Receipt,
}

/// Reason why workers did not roll out a group.
#[derive(Debug, thiserror::Error)]
pub enum RemoteRolloutError {
    /// No worker took the group, or the worker that had it is gone.
    #[error("no worker rolled out the group, or its worker is gone")]
    NoWorker,
    /// A worker could not roll out the group.
    #[error("a worker could not roll out the group: {0}")]
    Refused(String),
    /// The policy of the run has a newer version.
    #[error("the policy has a newer version")]
    Superseded,
    /// The job cannot be written.
    #[error(transparent)]
    Wire(#[from] RolloutWireError),
}

impl RolloutQueue {
    /// Returns how much of a kind all active workers roll out at once: groups, or episodes of a language model.
    #[must_use]
    pub fn room(&self, kind: JobKind) -> usize {
        if matches!(*self.0.link.lock(), Link::Down(_)) {
            return 0;
        }
        let registry = self.0.registry.lock();
        if kind == JobKind::RolloutChat { registry.chat_calls() } else { registry.slots(kind) }
    }

    /// Lets a worker roll out a group. Dropping the future forgets the group.
    ///
    /// # Errors
    /// Returns [`RemoteRolloutError`] if no worker rolled it out.
    pub async fn roll_out(&self, job: &RolloutJob) -> Result<RemoteRollout, RemoteRolloutError> {
        let reply = self.0.ask_worker(job.policy.kind(), job.encode()?).await;
        self.0.take_rollout(job, reply.ok_or(RemoteRolloutError::NoWorker)?)
    }
}

impl Shared {
    /// Uses the reply of a worker to a rollout.
    fn take_rollout(
        self: &Arc<Self>,
        job: &RolloutJob,
        reply: RemoteReply,
    ) -> Result<RemoteRollout, RemoteRolloutError> {
        let RemoteReply { worker, envelope, acker } = reply;
        let error = match envelope.reply {
            JobReply::Done { .. } if !self.registry.lock().may_work(&worker) => {
                self.count(|counters| counters.ignored_results += 1);
                RemoteRolloutError::Refused(format!("{worker} was expelled"))
            }
            JobReply::Done { body, .. } => match RolledOutGroup::decode(job, body.bytes()) {
                Ok(group) => {
                    let bytes = body.bytes().len() as u64;
                    self.count(|counters| counters.count_remote(job.policy.kind(), bytes));
                    self.registry.lock().count_rollout(&worker);
                    return Ok(RemoteRollout { group, receipt: self.receipt(acker) });
                }
                Err(error) => {
                    let reason = format!("its group of a {} job is invalid: {error}", job.policy.kind());
                    self.expel(&worker, reason.clone());
                    RemoteRolloutError::Refused(reason)
                }
            },
            JobReply::Failed(reason) | JobReply::Refused(reason) => {
                tracing::warn!(worker, reason, "A worker could not roll out a group.");
                self.registry.lock().count_error(&worker);
                RemoteRolloutError::Refused(reason)
            }
            JobReply::Superseded => RemoteRolloutError::Superseded,
        };
        self.acknowledge(acker);
        Err(error)
    }
}
