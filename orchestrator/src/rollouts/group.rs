//! A leased group with everything that its rollout needs, and its form for the audit and the feed.

use crate::api_enums::ConvertEnum;
use api_types::{ActionStopReason, MessageContent, ObservationContent, ObservationMode, PolicySettings};
use env_core::{Bracket, Scenario, StopReason};
use policy_files::{PolicyFolder, PolicyReference};
use rollout::{ChatSampling, RolledOutGroup, RolloutJob, RolloutOutcome, RolloutPolicy};
use store::groups::{self, GroupRow};
use store::ids::{EpisodeId, LayoutId, LeaseId, RunId};
use store::leases::LeaseRow;
use store::run_policies::{RunPolicy, RunPolicyRow};
use store::scenarios::ScenarioLoader;
use store::{StoreError, brackets, from_json, runs, to_json, to_u32, to_u64};

use crate::engine::error::ServiceError;
use crate::leases::bracket_view::scenario_bracket;
use crate::leases::lease_service::LeaseService;
use crate::results::audit_outcome::{AuditOutcome, AuditedEpisode};
use crate::results::reported::{ReportedEpisode, ReportedOutcome};
use crate::rollouts::group_record::{EpisodeRecord, GroupRecord};
use crate::rollouts::packed_group::PackError;
use crate::rollouts::rollout_lease::RolloutLease;
use crate::rollouts::settings::settings_from_row;
use crate::runs::settings::RunSettings;
use env_core::frames::wire_step;

/// Error of rolling out a group.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// The group could not be leased, loaded or counted.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The group cannot be packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// No worker rolled out the group, and the server cannot.
    #[error("the server has no language model, and no worker rolled out the group: {0}")]
    NoWorker(String),
    /// The policy has a newer version.
    #[error("the policy has a newer version")]
    Superseded,
    /// The rollout itself failed.
    #[error("the rollout failed: {0}")]
    Failed(String),
}

/// A leased group with everything that its rollout needs.
#[derive(Debug)]
pub struct RolloutGroup {
    /// Id of the run.
    pub run: RunId,
    /// Id of the lease.
    pub lease: LeaseId,
    /// The policy to roll out.
    pub policy: RunPolicyRow,
    /// Settings of the policy.
    pub settings: PolicySettings,
    /// Scenario of every episode.
    pub scenario: Scenario,
    row: LeaseRow,
    group: GroupRow,
    bracket: Bracket,
    run_seed: u64,
    /// Finished episodes from which the group counts.
    min_group: usize,
}

impl RolloutGroup {
    /// Loads the group of a rollout lease.
    ///
    /// # Errors
    /// Returns [`ServiceError::UnknownRun`] if the run is gone, and [`ServiceError::Store`] if something cannot be read.
    pub async fn load(
        lease_service: &LeaseService,
        run: RunId,
        RolloutLease { lease, policy }: RolloutLease,
    ) -> Result<Self, ServiceError> {
        let mut conn = lease_service.readers.acquire().await?;
        let row = crate::leases::find::find_lease(&mut conn, &run, &lease).await?;
        let no_group = || StoreError::corrupt("a lease", "it has no group");
        let group = groups::get(&mut conn, row.id, 0).await?.ok_or_else(no_group)?;
        let scenario = ScenarioLoader::default().get(&mut conn, &group.scenario).await?;
        let bracket = brackets::newest(&mut conn, &group.scenario).await?;
        let bracket =
            bracket.ok_or_else(|| StoreError::corrupt("a bracket", "there is none for a leased scenario"))?;
        let stored = runs::get(&mut conn, run.as_str()).await?;
        let stored = stored.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
        let settings: RunSettings = from_json("a run's settings", &stored.settings)?;
        Ok(Self {
            settings: settings_from_row(&policy)?,
            min_group: settings.min_group_for(to_u32(row.group_size)) as usize,
            run_seed: to_u64(stored.seed),
            run,
            lease,
            policy,
            scenario,
            row,
            group,
            bracket,
        })
    }

    /// Returns the number of episodes to roll out.
    #[must_use]
    pub fn size(&self) -> u32 {
        to_u32(self.row.group_size)
    }

    /// Returns the job that rolls out the group. A policy file gets the hash that the file of this server has now.
    ///
    /// # Errors
    /// Returns [`RolloutError::Failed`] if the policy file cannot be read.
    pub fn to_job(&self, folder: &PolicyFolder) -> Result<RolloutJob, RolloutError> {
        let PolicySettings { temperature, history, max_tokens, observations, .. } = self.settings;
        let policy = match &self.policy.policy {
            RunPolicy::Chat => RolloutPolicy::Chat(ChatSampling { temperature, history, max_tokens }),
            policy => {
                let pinned = folder.pin(&PolicyReference::parse(policy.as_str()));
                let pinned = pinned.map_err(|error| RolloutError::Failed(error.to_string()))?;
                RolloutPolicy::Reference(pinned.to_string())
            }
        };
        Ok(RolloutJob {
            run: self.run.to_string(),
            policy_version: self.policy.version,
            scenario: self.scenario.clone(),
            policy,
            seeds: (0..self.size()).map(|index| self.policy_seed(index)).collect(),
            records_observations: observations == ObservationMode::Telemetry,
        })
    }

    /// Returns the seed of a stochastic policy: different for each episode, and the same at every call.
    fn policy_seed(&self, index: u32) -> u64 {
        let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 rollout seeds");
        hasher.update(&self.run_seed.to_le_bytes());
        hasher.update(&self.row.id.to_le_bytes());
        hasher.update(&index.to_le_bytes());
        let mut bits = [0; 8];
        hasher.finalize_xof().fill(&mut bits);
        u64::from_le_bytes(bits) >> 13 // below 2^51
    }

    /// Returns the id of an episode.
    fn episode_id(&self, index: usize) -> String {
        let index = i64::try_from(index).unwrap_or(i64::MAX);
        EpisodeId { lease: self.lease.clone(), index }.to_string()
    }

    /// Returns the episodes as a trainer would report them.
    ///
    /// # Errors
    /// Returns [`ServiceError::Store`] if metrics cannot be written as JSON.
    pub fn to_reports(&self, outcomes: &[RolloutOutcome]) -> Result<Vec<ReportedEpisode>, ServiceError> {
        let report = |(index, outcome): (usize, &RolloutOutcome)| {
            let reported = match &outcome.episode {
                Ok(recorded) => ReportedOutcome::Finished {
                    steps: recorded.log.steps().map(|step| wire_step(&recorded.log, step)).collect(),
                    precision: recorded.log.precision(),
                    stopped: recorded.log.stopped,
                },
                Err(reason) => ReportedOutcome::Failed { reason: reason.clone() },
            };
            let metrics = outcome.metrics.map(|metrics| to_json(&metrics)).transpose()?;
            Ok(ReportedEpisode {
                episode: self.episode_id(index),
                outcome: reported,
                policy_version: None,
                metrics,
            })
        };
        outcomes.iter().enumerate().map(report).collect()
    }

    /// Returns the group for the feed. `None` if too few episodes finished to count, if the group is not for training, or if all
    /// scores are equal and the run wants no such groups.
    ///
    /// # Errors
    /// Returns an error if an episode does not replay.
    pub fn to_trajectory(
        &self,
        rolled_out: RolledOutGroup,
        audited: &[AuditedEpisode],
    ) -> Result<Option<GroupRecord>, ServiceError> {
        let RolledOutGroup { outcomes, lacks_observations, lacks_messages, .. } = rolled_out;
        let failed = outcomes.iter().filter(|outcome| outcome.episode.is_err()).count();
        let finished = outcomes.len() - failed;
        if finished == 0 || finished < self.min_group || !self.group.is_for_training {
            return Ok(None);
        }
        let is_chat = outcomes.iter().any(|outcome| outcome.metrics.is_some());
        let mut episodes = Vec::with_capacity(finished);
        for (outcome, audited) in outcomes.into_iter().zip(audited) {
            episodes.extend(trajectory_episode(outcome, audited)?);
        }
        let scores_are_equal =
            episodes.windows(2).all(|pair| pair[0].score.total_cmp(&pair[1].score).is_eq());
        if self.settings.refill && scores_are_equal && episodes.len() > 1 {
            return Ok(None);
        }
        let mut group = self.group_record(failed, episodes, is_chat);
        if lacks_observations {
            group.drop_observations();
        }
        if lacks_messages {
            group.drop_messages();
        }
        Ok(Some(group))
    }

    /// Returns the group with its episodes.
    fn group_record(&self, failed: usize, episodes: Vec<EpisodeRecord>, is_chat: bool) -> GroupRecord {
        GroupRecord {
            run: self.run.to_string(),
            lease: self.lease.to_string(),
            group: self.group.number,
            task: self.group.task.clone(),
            level: self.group.level,
            role: self.group.role.convert(),
            layout: self.group.layout.map(|id| LayoutId::of_run(self.run.as_str(), id).to_string()),
            recipe: self.scenario.recipe().to_json(),
            seed: self.scenario.seed().get(),
            scenario: self.scenario.id().to_string(),
            contested: self.group.is_contested,
            bracket: scenario_bracket(&self.scenario, &self.bracket),
            policy: self.policy.policy.to_string(),
            policy_version: self.row.policy_version,
            observations: match self.settings.observations {
                ObservationMode::Telemetry => ObservationContent::Telemetry,
                ObservationMode::None => ObservationContent::None,
            },
            messages: if is_chat { MessageContent::Kept } else { MessageContent::None },
            failed,
            episodes,
        }
    }
}

/// Returns an episode for the feed; `None` if the infrastructure lost it.
///
/// # Errors
/// Returns an error if the episode does not replay, and [`ServiceError::Expired`] if it was reported before.
fn trajectory_episode(
    outcome: RolloutOutcome,
    audited: &AuditedEpisode,
) -> Result<Option<EpisodeRecord>, ServiceError> {
    let Ok(recorded) = outcome.episode else { return Ok(None) };
    let replayed = match &audited.outcome {
        AuditOutcome::Replayed(replayed) => replayed,
        AuditOutcome::Failed(reason) => {
            return Err(ServiceError::invalid("rollout", format!("{}: {reason}", audited.episode)));
        }
        AuditOutcome::Refused(refusal) => {
            let reason = format!("{}: {}", audited.episode, refusal.detail);
            return Err(ServiceError::invalid("rollout", reason));
        }
        AuditOutcome::Known { .. } => return Err(ServiceError::Expired(audited.episode.clone())),
    };
    Ok(Some(EpisodeRecord {
        id: audited.episode.clone(),
        score: replayed.outcome.score,
        skill: replayed.skill,
        success: replayed.is_success,
        stopped: recorded.log.stopped.map(action_stop_reason),
        metrics: outcome.metrics,
        steps: recorded.steps,
        last_observation: recorded.last_observation,
    }))
}

const fn action_stop_reason(reason: StopReason) -> ActionStopReason {
    match reason {
        StopReason::Unparsable => ActionStopReason::Unparsable,
        StopReason::TooLong => ActionStopReason::TooLong,
        StopReason::TooLate => ActionStopReason::TooLate,
    }
}
