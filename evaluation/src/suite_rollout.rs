//! Rollouts of policies on a suite.

use env_core::policy_factory::PolicyFactory;
use env_core::rollout;
use rayon::prelude::*;

use super::results::{EpisodeMeasures, PolicyResults, measure_episode};
use super::suite::{Suite, SuiteEntry};

/// Settings of stochastic policies.
#[derive(Debug, Clone, Copy)]
pub struct SuiteRolloutSettings {
    /// Seed from which the policy's seeds are derived.
    pub seed: u64,
    /// Number of episodes of a stochastic policy on each scenario; other policies run one.
    pub rollouts: u32,
}

/// Error of a scenario that a policy cannot run on.
#[derive(Debug, thiserror::Error)]
#[error("{policy} on scenario {scenario}: {source}")]
pub struct SuiteRolloutError {
    policy: String,
    scenario: String,
    source: Box<dyn std::error::Error + Send + Sync>,
}

/// Rolls out a policy on every scenario of a suite, in parallel. `on_scenario` is called after each scenario.
///
/// # Errors
/// Returns an error if the policy cannot act in a task or an episode fails.
pub fn roll_out_policy(
    suite: &Suite,
    policy: &dyn PolicyFactory,
    settings: SuiteRolloutSettings,
    on_scenario: &(dyn Fn() + Sync),
) -> Result<PolicyResults, SuiteRolloutError> {
    let entries: Vec<&SuiteEntry> = suite.entries().collect();
    let is_stochastic = |entry: &SuiteEntry| policy.is_stochastic(entry.scenario.task());
    let is_any_stochastic = entries.iter().any(|entry| is_stochastic(entry));
    let episodes = entries.into_par_iter().map(|entry| {
        let rollouts = if is_stochastic(entry) { settings.rollouts } else { 1 };
        let episodes =
            (0..rollouts).map(|rollout| roll_out_once(entry, policy, settings.seed, rollout)).collect();
        on_scenario();
        episodes
    });
    let episodes = episodes.collect::<Result<_, SuiteRolloutError>>()?;
    Ok(PolicyResults { policy: policy.name().to_owned(), is_stochastic: is_any_stochastic, episodes })
}

fn roll_out_once(
    entry: &SuiteEntry,
    policy: &dyn PolicyFactory,
    seed: u64,
    rollout: u32,
) -> Result<EpisodeMeasures, SuiteRolloutError> {
    let scenario = &entry.scenario;
    let failed = |source: Box<dyn std::error::Error + Send + Sync>| SuiteRolloutError {
        policy: policy.name().to_owned(),
        scenario: scenario.id().to_string(),
        source,
    };
    let seed = derive_seed(seed, policy.name(), entry, rollout);
    let mut agent = policy.create(scenario, seed).map_err(|error| failed(error.into()))?;
    let outcome = rollout::roll_out(scenario, &mut *agent).map_err(|error| failed(error.into()))?.outcome;
    Ok(measure_episode(entry, &outcome))
}

/// Derives the policy's seed for one (seed, policy, scenario, rollout).
fn derive_seed(seed: u64, policy: &str, entry: &SuiteEntry, rollout: u32) -> u64 {
    let mut hasher = blake3::Hasher::new_derive_key("sparring eval policy seed 1");
    hasher.update(&seed.to_le_bytes()).update(&rollout.to_le_bytes());
    hasher.update(&entry.scenario.id().0).update(policy.as_bytes());
    let mut word = [0; 8];
    word.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    u64::from_le_bytes(word)
}
