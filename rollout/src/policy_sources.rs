//! Policies that a process can roll out, and the rollout of a group by one of them.

use std::panic::AssertUnwindSafe;
use std::sync::Arc;

use futures_util::future::join_all;
use llm::LlmClient;
use llm_policy::ChatSettings;
use policy_files::{PolicyFileError, PolicyFolder, PolicyReference};
use rayon::ThreadPool;
use rayon::prelude::*;
use tokio::sync::oneshot;

use crate::group::RolledOutGroup;
use crate::job::{ChatSampling, RolloutJob, RolloutPolicy};
use crate::recorder::RecordingBudget;
use crate::run_episode::{PolicyEpisode, RolloutOutcome, roll_out_chat, roll_out_policy};

/// Language model of chat policies: the one that the process was started with.
#[derive(Debug, Clone)]
pub struct Endpoint {
    /// Client of the model.
    pub llm: LlmClient,
    /// Sampling temperature of runs that set none.
    pub temperature: Option<f64>,
}

/// Policies of a process, besides the built-in ones.
#[derive(Debug, Clone, Default)]
pub struct PolicySources {
    /// Language model of the policy `chat`, if one is configured.
    pub endpoint: Option<Endpoint>,
    /// Folder of policy files, if one is configured.
    pub folder: PolicyFolder,
}

/// Reason why a group was not rolled out.
#[derive(Debug, thiserror::Error)]
pub enum RolloutFailure {
    /// The policy file is missing, invalid, or another one than the job names.
    #[error(transparent)]
    PolicyFile(#[from] PolicyFileError),
    /// No language model is configured.
    #[error("there is no language model for the policy chat; name one with --policy-url and --policy-model")]
    NoModel,
    /// The policy or its threads panicked.
    #[error("a policy panicked")]
    Panicked,
}

impl PolicySources {
    /// Rolls out all episodes of a group: those of chat concurrently, those of other policies on the threads of `pool`. Dropping the
    /// future ends the rollout.
    ///
    /// # Errors
    /// Returns [`RolloutFailure`] if this process cannot roll out the policy. An episode that the infrastructure loses is no error.
    pub async fn roll_out(
        &self,
        job: &Arc<RolloutJob>,
        pool: &ThreadPool,
    ) -> Result<RolledOutGroup, RolloutFailure> {
        match &job.policy {
            RolloutPolicy::Chat(sampling) => {
                let endpoint = self.endpoint.as_ref().ok_or(RolloutFailure::NoModel)?;
                Ok(converse(job, endpoint, *sampling).await)
            }
            RolloutPolicy::Reference(text) => self.act(job, PolicyReference::parse(text), pool).await,
        }
    }

    /// Rolls out a group by a built-in policy or one from a file.
    async fn act(
        &self,
        job: &Arc<RolloutJob>,
        reference: PolicyReference,
        pool: &ThreadPool,
    ) -> Result<RolledOutGroup, RolloutFailure> {
        let (sender, receiver) = oneshot::channel();
        let (job, folder) = (Arc::clone(job), self.folder.clone());
        pool.spawn(move || {
            let is_wanted = || !sender.is_closed();
            // A policy that panics loses its own group, and no other.
            let group = std::panic::catch_unwind(AssertUnwindSafe(|| {
                act_on_threads(&job, &folder, &reference, &is_wanted)
            }));
            // The receiver is gone if the group is not wanted any more.
            drop(sender.send(group.unwrap_or(Err(RolloutFailure::Panicked))));
        });
        receiver.await.unwrap_or(Err(RolloutFailure::Panicked))
    }
}

/// Rolls out a group in parallel on the current thread pool.
fn act_on_threads(
    job: &RolloutJob,
    folder: &PolicyFolder,
    reference: &PolicyReference,
    is_wanted: &(dyn Fn() -> bool + Sync),
) -> Result<RolledOutGroup, RolloutFailure> {
    let policy = folder.open(reference)?;
    let budget = RecordingBudget::new(job.records_observations);
    let episode = |&seed: &u64| {
        let (scenario, policy, budget) = (&job.scenario, &*policy, &budget);
        roll_out_policy(&PolicyEpisode { scenario, policy, seed, budget, is_wanted })
    };
    let outcomes = job.seeds.par_iter().map(episode).collect();
    Ok(rolled_out(outcomes, &budget, 0.0))
}

/// Rolls out a group by a language model, all episodes at once.
async fn converse(job: &RolloutJob, endpoint: &Endpoint, sampling: ChatSampling) -> RolledOutGroup {
    let budget = RecordingBudget::new(job.records_observations);
    let settings = ChatSettings {
        run: job.run.clone(),
        history: sampling.history as usize,
        temperature: sampling.temperature.or(endpoint.temperature),
        max_tokens: sampling.max_tokens.unwrap_or(endpoint.llm.config().max_tokens),
    };
    let episode = |_: &u64| roll_out_chat(&job.scenario, &endpoint.llm, settings.clone(), &budget);
    let outcomes = join_all(job.seeds.iter().map(episode)).await;
    let metrics = || outcomes.iter().filter_map(|outcome| outcome.metrics);
    let tokens_in = metrics().map(|metrics| metrics.tokens_in).sum();
    let tokens_out = metrics().map(|metrics| metrics.tokens_out).sum();
    let cost = endpoint.llm.config().cost(tokens_in, tokens_out);
    rolled_out(outcomes, &budget, cost)
}

fn rolled_out(outcomes: Vec<RolloutOutcome>, budget: &RecordingBudget, cost: f64) -> RolledOutGroup {
    RolledOutGroup {
        outcomes,
        lacks_observations: budget.lacks_observations(),
        lacks_messages: budget.lacks_messages(),
        cost,
    }
}
