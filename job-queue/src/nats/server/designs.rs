//! Designs by workers. A language model is no pure function of its job, so the server does not repeat a design: it checks every layout,
//! and judges a random share of them again.

use std::sync::Arc;

use designer::DesignOutcome;
use designer::design_thread::DesignResult;
use jobs::design::{DesignFault, DesignJob, DesignOutput};
use jobs::envelope::{JobReply, ReplyBody};
use jobs::{JobKind, WireError};

use super::pending::RemoteReply;
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
        let shared = &self.0;
        let reply = shared.ask_worker(job.designer.kind(), job.encode()?).await;
        let RemoteReply { worker, envelope, acker } = reply.ok_or(RemoteDesignError::NoWorker)?;
        let error = match envelope.reply {
            JobReply::Done { .. } if !shared.registry.lock().may_work(&worker) => {
                shared.count(|counters| counters.ignored_results += 1);
                RemoteDesignError::Refused(format!("{worker} was expelled"))
            }
            JobReply::Done { body, .. } => match shared.check_design(&worker, &job, &body).await? {
                Ok(result) => return Ok(RemoteDesign { result, receipt: shared.receipt(acker) }),
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
    /// Checks the layouts of a worker on a background thread, and counts them.
    async fn check_design(
        &self,
        worker: &str,
        job: &Arc<DesignJob>,
        body: &ReplyBody,
    ) -> Result<Result<DesignResult, WrongDesign>, JobError> {
        let (share, is_due) = (self.config.verified_share, self.registry.lock().is_unknown(worker));
        let (job, body, kind) = (Arc::clone(job), body.clone(), job.designer.kind());
        let bytes = body.bytes().len() as u64;
        let checked = self.local.run_in_background(move || check(&job, &body, share, is_due)).await?;
        Ok(checked.map(|CheckedDesign { result, audited }| {
            self.count(|counters| {
                counters.count_remote(kind, bytes);
                counters.verified_items += audited;
            });
            self.registry.lock().count_design(worker, audited);
            result
        }))
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
