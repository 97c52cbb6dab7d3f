//! One rollout of a worker.

use std::sync::Arc;
use std::time::Instant;

use jobs::JobKind;
use jobs::envelope::{JobEnvelope, JobReply, ReplyBody};
use rollout::{RolloutFailure, RolloutJob};

use super::WorkerProcess;
use super::run_versions::JobVersion;

/// Rolls out the group of a job, unless its policy gets a newer version.
pub(super) async fn roll_out(state: &WorkerProcess, envelope: &JobEnvelope) -> JobReply {
    let started = Instant::now();
    let job = match RolloutJob::decode(envelope.body()) {
        Ok(job) => Arc::new(job),
        Err(error) => return JobReply::Failed(format!("the job cannot be read: {error}")),
    };
    // The permit under which the job was taken is for its first episode.
    let _calls = (envelope.kind == JobKind::RolloutChat).then(|| {
        let further = job.seeds.len().saturating_sub(1).min(state.chat_calls.available_permits());
        state.chat_calls.try_acquire_many(u32::try_from(further).unwrap_or(u32::MAX))
    });
    let version = JobVersion { run: &job.run, server: &envelope.server, version: job.policy_version };
    let rolled_out = tokio::select! {
        biased;
        () = state.run_versions.superseded(version) => return JobReply::Superseded,
        rolled_out = state.config.policies.roll_out(&job, &state.pool) => rolled_out,
    };
    let group = match rolled_out {
        Ok(group) => group,
        Err(error @ RolloutFailure::Panicked) => return JobReply::Failed(error.to_string()),
        Err(error) => return JobReply::Refused(format!("{} on {}: {error}", state.id, state.config.host)),
    };
    match tokio::task::spawn_blocking(move || group.encode()).await {
        Ok(Ok(body)) => {
            let micros = u64::try_from(started.elapsed().as_micros()).unwrap_or(u64::MAX);
            JobReply::Done { body: ReplyBody::new(body), micros }
        }
        Ok(Err(error)) => JobReply::Failed(error.to_string()),
        Err(error) => JobReply::Failed(error.to_string()),
    }
}
