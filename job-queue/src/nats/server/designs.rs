//! Designs by workers. A language model is no pure function of its job, so the server does not repeat a design: it checks every layout,
//! and judges a random share of them again.

use std::sync::Arc;

use designer::DesignOutcome;
use designer::design_thread::DesignResult;
use jobs::design::{DesignFault, DesignJob, DesignOutput};
use jobs::envelope::{JobReply, ReplyBody};
use jobs::{JobKind, WireError};

use super::pending::RemoteReply;
use super::unverified::UnverifiedDesign;
use super::{Link, Shared};
use crate::queue::{JobError, Receipt};

/// Designs by the workers of a server.
#[derive(Debug, Clone)]
pub struct DesignQueue(pub(super) Arc<Shared>);

/// Layouts that a worker designed, as the gate of this process admits them.
pub struct RemoteDesign {
    /// The layouts, and the gate that knows the admitted ones.
    pub result: DesignResult,
    /// Receipt to acknowledge after the commit.
    pub receipt: Receipt,
}

/// Reason why workers did not design.
#[derive(Debug, thiserror::Error)]
pub enum RemoteDesignError {
    /// No worker took the request, or the worker that had it is gone.
    #[error("no worker took the design request, or its worker is gone")]
    NoWorker,
    /// A worker could not design, or its layouts are wrong.
    #[error("a worker could not design: {0}")]
    Refused(String),
    /// The job cannot be written.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// The layouts could not be checked.
    #[error(transparent)]
    Check(#[from] JobError),
}

/// Layouts of a worker that passed the check.
struct CheckedDesign {
    result: DesignResult,
    /// Number of layouts that were judged again.
    audited: u64,
}

/// Reason why the layouts of a worker cannot be used.
#[derive(Debug, thiserror::Error)]
enum WrongDesign {
    #[error(transparent)]
    Wire(#[from] WireError),
    #[error(transparent)]
    Fault(#[from] DesignFault),
}

impl DesignQueue {
    /// True if an active worker takes jobs of a kind.
    #[must_use]
    pub fn is_served(&self, kind: JobKind) -> bool {
        self.room(kind) > 0
    }

    /// True if a worker can begin a job of a kind now.
    #[must_use]
    pub fn has_room(&self, kind: JobKind) -> bool {
        self.0.pending.count(kind) < self.room(kind)
    }

    /// Number of requests of a kind that all active workers design at once.
    fn room(&self, kind: JobKind) -> usize {
        if matches!(*self.0.link.lock(), Link::Down(_)) {
            return 0;
        }
        self.0.registry.lock().design_slots(kind)
    }

    /// Lets a worker design layouts. Dropping the future forgets the request.
    ///
    /// # Errors
    /// Returns [`RemoteDesignError`] if no worker designed layouts that pass the gate of this process.
    pub async fn design(&self, job: Arc<DesignJob>) -> Result<RemoteDesign, RemoteDesignError> {
        let (shared, message) = (&self.0, job.encode()?);
        let sent_bytes = message.len();
        let reply = shared.ask_worker(job.designer.kind(), message).await;
        let RemoteReply { worker, envelope, acker } = reply.ok_or(RemoteDesignError::NoWorker)?;
        let error = match envelope.reply {
            JobReply::Done { .. } if !shared.registry.lock().may_work(&worker) => {
                shared.ignore_design(&worker)
            }
            JobReply::Done { body, .. } => match shared.check_design(&worker, &job, &body).await? {
                Ok(CheckedDesign { result, audited }) => {
                    let bytes = sent_bytes + body.bytes().len();
                    let unverified = UnverifiedDesign { job: Arc::clone(&job), body, bytes };
                    if shared.count_design(&worker, audited, unverified) {
                        return Ok(RemoteDesign { result, receipt: shared.receipt(acker) });
                    }
                    shared.ignore_design(&worker)
                }
                Err(wrong) => {
                    let reason = format!("its result of a {} job is wrong: {wrong}", job.designer.kind());
                    shared.expel(&worker, reason.clone());
                    RemoteDesignError::Refused(reason)
                }
            },
            JobReply::Failed(reason) | JobReply::Refused(reason) => {
                tracing::warn!(worker, reason, "A worker could not design layouts.");
                shared.registry.lock().count_error(&worker);
                RemoteDesignError::Refused(reason)
            }
            // No policy has a part in these jobs.
            JobReply::Superseded => RemoteDesignError::NoWorker,
        };
        shared.acknowledge(acker);
        Err(error)
    }
}

impl Shared {
    /// Checks the layouts of a worker on a background thread.
    async fn check_design(
        &self,
        worker: &str,
        job: &Arc<DesignJob>,
        body: &ReplyBody,
    ) -> Result<Result<CheckedDesign, WrongDesign>, JobError> {
        let (share, is_due) = (self.config.verified_share, self.registry.lock().must_judge(worker));
        let (job, body) = (Arc::clone(job), body.clone());
        self.local.run_in_background(move || check(&job, &body, share, is_due)).await
    }

    /// Counts the layouts of a request. Returns false if they may not be used, because their worker was expelled meanwhile.
    fn count_design(&self, worker: &str, judged: u64, unverified: UnverifiedDesign) -> bool {
        let (kind, bytes) = (unverified.job.designer.kind(), unverified.body.bytes().len() as u64);
        let is_counted = self.registry.lock().count_design(worker, judged, unverified);
        if is_counted {
            self.count(|counters| {
                counters.count_remote(kind, bytes);
                counters.verified_items += judged;
            });
        }
        is_counted
    }

    /// Counts layouts that are not used.
    fn ignore_design(&self, worker: &str) -> RemoteDesignError {
        self.count(|counters| counters.ignored_results += 1);
        RemoteDesignError::Refused(format!("{worker} was expelled"))
    }
}

/// Checks the layouts of a job. Each is judged again with the probability `share`, and one of them in any case if `is_due`.
fn check(job: &DesignJob, body: &ReplyBody, share: f64, is_due: bool) -> Result<CheckedDesign, WrongDesign> {
    let output = DesignOutput::decode(body.bytes())?;
    let mut audited: Vec<bool> = output.layouts.iter().map(|_| rand::random::<f64>() < share).collect();
    if is_due && !audited.is_empty() {
        let drawn = (rand::random::<u64>() % audited.len() as u64) as usize;
        audited[drawn] = true;
    }
    let mut gate = job.gate()?;
    let outcome: DesignOutcome =
        output.check(job, &mut gate, |index| audited.get(index).copied().unwrap_or(true))?;
    let audited = audited.into_iter().filter(|is_audited| *is_audited).count() as u64;
    Ok(CheckedDesign { result: DesignResult { designer: job.designer.name(), outcome, gate }, audited })
}
