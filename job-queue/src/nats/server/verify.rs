//! Trust in workers: the server recomputes a random share of their results.

use std::collections::BTreeSet;
use std::sync::Arc;

use jobs::design::{DesignOutput, RejudgedLayout};
use jobs::prepare::job::PrepareOutcome;
use jobs::{JobOutput, JobPayload};

use super::Shared;
use super::registry::ExpelledWorker;
use super::unverified::{UnverifiedDesign, UnverifiedJob};
use crate::queue::JobError;
use crate::status::{QueueNotice, Recomputation, WrongLayout, WrongResult};

/// Items of a result that the server recomputes before it uses the result.
#[derive(Debug, Default)]
pub(super) struct ItemsToVerify {
    /// Items that the worker reports as failed. No failure is believed.
    failed: BTreeSet<usize>,
    /// An item that was drawn.
    drawn: Option<usize>,
}

impl ItemsToVerify {
    /// Draws an item with the probability that each is drawn with `share`, or always if `is_due`.
    pub(super) fn choose(output: &JobOutput, share: f64, is_due: bool) -> Self {
        let failed = failed_items(output);
        let comparable: Vec<usize> = (0..output.len()).filter(|&item| is_comparable(output, item)).collect();
        let chance =
            1.0 - (1.0 - share.clamp(0.0, 1.0)).powi(i32::try_from(comparable.len()).unwrap_or(i32::MAX));
        let is_drawn = is_due || rand::random::<f64>() < chance;
        let index = rand::random::<u64>() % (comparable.len().max(1) as u64);
        let drawn = comparable.get(index as usize).copied().filter(|_| is_drawn);
        Self { failed, drawn }
    }

    fn all(&self) -> BTreeSet<usize> {
        self.failed.iter().copied().chain(self.drawn).collect()
    }
}

/// Items that a worker reports as failed.
fn failed_items(output: &JobOutput) -> BTreeSet<usize> {
    use jobs::audit::AuditOutput;
    let has_failed = |item: &usize| match output {
        JobOutput::Prepare(output) => matches!(output.0.get(*item), Some(PrepareOutcome::Failed(_))),
        JobOutput::Audit(AuditOutput::Brackets(brackets)) => matches!(brackets.get(*item), Some(None)),
        JobOutput::Audit(AuditOutput::Replays(outcomes)) => matches!(outcomes.get(*item), Some(Err(_))),
        JobOutput::Critique(output) => matches!(output.0.get(*item), Some(Err(_))),
    };
    (0..output.len()).filter(has_failed).collect()
}

/// False for an item that the worker left undone because its time was up.
fn is_comparable(output: &JobOutput, item: usize) -> bool {
    !matches!(output, JobOutput::Prepare(output) if matches!(output.0.get(item), Some(PrepareOutcome::Untried)))
}

impl Shared {
    /// Recomputes the chosen items of a result. Returns false if one of them differs.
    ///
    /// # Errors
    /// Returns [`JobError`] if the server cannot compute.
    pub(super) async fn agrees(
        &self,
        worker: &str,
        job: &JobPayload,
        output: &JobOutput,
        items: &ItemsToVerify,
    ) -> Result<bool, JobError> {
        let chosen = items.all();
        for &index in &chosen {
            let Some(item) = job.item(index) else { return Ok(false) };
            if !output.item_equals(index, &self.compute(Arc::new(item)).await?) {
                return Ok(false);
            }
        }
        self.count(|counters| counters.verified_items += chosen.len() as u64);
        if items.drawn.is_some() {
            self.registry.lock().count_agreement(worker, chosen.len() as u64);
        }
        Ok(true)
    }

    /// Expels a worker, and recomputes its results since the last agreement.
    pub(super) fn expel(self: &Arc<Self>, worker: &str, reason: String) {
        let Some(ExpelledWorker { identity, unverified }) = self.registry.lock().expel(worker, &reason)
        else {
            return;
        };
        self.notify(QueueNotice::Expelled(identity.clone(), reason));
        let shared = Arc::clone(self);
        tokio::spawn(async move {
            let mut found = Recomputation::new(identity);
            for UnverifiedJob { job, output, .. } in unverified.jobs {
                if shared.recompute(&job, &output, &mut found).await.is_err() {
                    return; // the process stops
                }
            }
            for design in unverified.designs {
                if shared.judge_again(design, &mut found).await.is_err() {
                    return;
                }
            }
            shared.notify(QueueNotice::Recomputed(found));
        });
    }

    /// Recomputes a job, and collects the items that differ.
    async fn recompute(
        &self,
        job: &JobPayload,
        reported: &JobOutput,
        found: &mut Recomputation,
    ) -> Result<(), JobError> {
        for index in (0..job.len()).filter(|&index| is_comparable(reported, index)) {
            let Some(item) = job.item(index) else { continue };
            let computed = self.compute(Arc::new(item.clone())).await?;
            found.items += 1;
            if !reported.item_equals(index, &computed) {
                found.wrong.push(WrongResult { job: item, computed });
            }
        }
        Ok(())
    }

    /// Judges the admitted layouts of a design request again, and collects those whose verdict differs.
    async fn judge_again(
        &self,
        UnverifiedDesign { job, body, .. }: UnverifiedDesign,
        found: &mut Recomputation,
    ) -> Result<(), JobError> {
        let judged = {
            let job = Arc::clone(&job);
            self.local
                .run_in_background(move || DesignOutput::decode(body.bytes())?.judge_admitted(&job))
                .await?
        };
        // The body was read before, when the layouts arrived.
        for RejudgedLayout { scenario, is_equal } in judged.unwrap_or_default() {
            found.items += 1;
            if !is_equal {
                let task = job.brief.recipe.task().id().to_owned();
                found.wrong_layouts.push(WrongLayout { run: job.run.clone(), task, scenario });
            }
        }
        Ok(())
    }
}
