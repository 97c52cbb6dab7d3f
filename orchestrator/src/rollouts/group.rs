//! A leased group: what it takes to fly it, and what is told of it once it was flown.

use env_core::{Bracket, Scenario};

use crate::rollouts::trajectory_group::{TrajectoryEpisode, TrajectoryGroup};
use crate::rollouts::run_episode::{RolloutOutcome, RecordingBudget};
use crate::rollouts::settings::{Observations, PolicySettings};
use crate::frames::wire_step;
use crate::ids::{EpisodeId, LayoutId, LeaseId, RunId};
use crate::store::groups::{self, GroupRow};
use crate::store::leases::LeaseRow;
use crate::store::run_policies::RunPolicyRow;
use crate::store::scenarios::ScenarioLoader;
use crate::store::{StoreError, brackets, from_json, runs, to_u32, to_json, to_u64};
use crate::results::audit_outcome::{AuditOutcome, AuditedEpisode};
use crate::results::reported::{ReportedEpisode, ReportedOutcome};
use crate::engine::error::ServiceError;
use crate::leases::bracket_view::BracketView;
use crate::leases::lease_service::LeaseService;
use crate::runs::settings::RunSettings;

/// A group that cannot be flown or told of.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// It was not taken, or not counted.
    #[error(transparent)]
    Training(#[from] ServiceError),
    /// It cannot be kept.
    #[error(transparent)]
    Body(#[from] crate::rollouts::trajectory_group::BodyError),
    /// A thread that flew it ended.
    #[error("what flew it ended: {0}")]
    Thread(String),
}

/// A leased group with all that is needed to fly it.
#[derive(Debug)]
pub struct RolloutGroup {
    /// Its run.
    pub run: RunId,
    /// Its lease.
    pub lease: LeaseId,
    /// The policy that flies it.
    pub policy: RunPolicyRow,
    /// How that is set.
    pub settings: PolicySettings,
    /// What is flown.
    pub scenario: Scenario,
    row: LeaseRow,
    group: GroupRow,
    bracket: Bracket,
    run_seed: u64,
    /// Finished episodes from which the group counts.
    enough: usize,
}

impl RolloutGroup {
    /// Reads what was leased.
    ///
    /// # Errors
    /// The store's.
    pub async fn load(
        desk: &LeaseService,
        run: RunId,
        lease: LeaseId,
        policy: RunPolicyRow,
    ) -> Result<Self, ServiceError> {
        let mut conn = desk.readers.acquire().await?;
        let row = crate::leases::find::find_lease(&mut conn, &run, &lease).await?;
        let gone = || StoreError::corrupt("a lease", "it has no group");
        let group = groups::get(&mut conn, row.id, 0).await?.ok_or_else(gone)?;
        let scenario = ScenarioLoader::default().get(&mut conn, &group.scenario).await?;
        let bracket = brackets::newest(&mut conn, &group.scenario).await?;
        let bracket = bracket
            .ok_or_else(|| StoreError::corrupt("a bracket", "there is none for a leased scenario"))?;
        let stored = runs::get(&mut conn, run.as_str()).await?;
        let stored = stored.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
        let told: RunSettings = from_json("a run's settings", &stored.settings)?;
        Ok(Self {
            settings: PolicySettings::of(&policy)?,
            enough: told.enough(to_u32(row.group_size)) as usize,
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

    /// Episodes to fly.
    #[must_use]
    pub fn size(&self) -> u32 {
        to_u32(self.row.group_size)
    }

    /// Room for what is kept of them.
    #[must_use]
    pub fn room(&self) -> RecordingBudget {
        RecordingBudget::new(self.settings.observations == Observations::Telemetry)
    }

    /// What a policy with chance in it draws from: another for each episode, the same whenever it is asked.
    #[must_use]
    pub fn seed(&self, index: u32) -> u64 {
        let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 rollout seeds");
        hasher.update(&self.run_seed.to_le_bytes());
        hasher.update(&self.row.id.to_le_bytes());
        hasher.update(&index.to_le_bytes());
        let mut bits = [0; 8];
        hasher.finalize_xof().fill(&mut bits);
        u64::from_le_bytes(bits) >> 13 // below 2^51
    }

    fn episode(&self, index: usize) -> String {
        let index = i64::try_from(index).unwrap_or(i64::MAX);
        EpisodeId { lease: self.lease.clone(), index }.to_string()
    }

    /// What is claimed of the episodes, as a trainer would.
    ///
    /// # Errors
    /// Metrics that cannot be written.
    pub fn claims(&self, outcomes: &[RolloutOutcome]) -> Result<Vec<ReportedEpisode>, ServiceError> {
        let claim = |(index, outcome): (usize, &RolloutOutcome)| {
            let reported = match &outcome.flight {
                Ok(flight) => ReportedOutcome::Finished {
                    steps: flight.log.steps().map(|step| wire_step(&flight.log, step)).collect(),
                    precision: flight.log.precision(),
                    stopped: flight.log.stopped,
                },
                Err(reason) => ReportedOutcome::Failed { reason: reason.clone() },
            };
            let metrics = outcome.metrics.map(|metrics| to_json(&metrics)).transpose()?;
            Ok(ReportedEpisode { episode: self.episode(index), outcome: reported, policy_version: None, metrics })
        };
        outcomes.iter().enumerate().map(claim).collect()
    }

    /// What is told of the group; none where too few of its episodes were flown to count, where it is not to be learnt from, and where
    /// there is nothing to learn from it and the run wants only others.
    ///
    /// # Errors
    /// An episode that does not replay.
    pub fn told(
        &self,
        outcomes: Vec<RolloutOutcome>,
        audited: &[AuditedEpisode],
        room: &RecordingBudget,
    ) -> Result<Option<TrajectoryGroup>, ServiceError> {
        let failed = outcomes.iter().filter(|outcome| outcome.flight.is_err()).count();
        let flown = outcomes.len() - failed;
        if flown == 0 || flown < self.enough || !self.group.is_for_training {
            return Ok(None);
        }
        let chat = outcomes.iter().any(|outcome| outcome.metrics.is_some());
        let mut episodes = Vec::with_capacity(flown);
        for (outcome, audited) in outcomes.into_iter().zip(audited) {
            let Ok(flight) = outcome.flight else { continue };
            let (score, skill, success) = match &audited.outcome {
                AuditOutcome::Replayed(replayed) => (replayed.outcome.score, replayed.skill, replayed.is_success),
                AuditOutcome::Failed(reason) => {
                    return Err(ServiceError::invalid("rollout", format!("{}: {reason}", audited.episode)));
                }
                AuditOutcome::Refused(refusal) => {
                    let reason = format!("{}: {}", audited.episode, refusal.detail);
                    return Err(ServiceError::invalid("rollout", reason));
                }
                AuditOutcome::Known { .. } => return Err(ServiceError::Expired(audited.episode.clone())),
            };
            episodes.push(TrajectoryEpisode {
                id: audited.episode.clone(),
                score,
                skill,
                success,
                stopped: flight.log.stopped.map(env_core::StopReason::name),
                metrics: outcome.metrics,
                steps: flight.steps,
                last_observation: flight.last,
            });
        }
        let flat = episodes.windows(2).all(|two| two[0].score.total_cmp(&two[1].score).is_eq());
        if self.settings.refill && flat && episodes.len() > 1 {
            return Ok(None);
        }
        let mut told = self.head(failed, episodes, chat);
        if room.lacks_observations() {
            told.drop_observations();
        }
        if room.lacks_messages() {
            told.drop_messages();
        }
        Ok(Some(told))
    }

    fn head(&self, failed: usize, episodes: Vec<TrajectoryEpisode>, chat: bool) -> TrajectoryGroup {
        TrajectoryGroup {
            run: self.run.to_string(),
            lease: self.lease.to_string(),
            group: self.group.number,
            task: self.group.task.clone(),
            level: self.group.level,
            role: self.group.role.to_string(),
            layout: self.group.layout.map(|id| LayoutId(id).to_string()),
            recipe: self.scenario.recipe().to_json(),
            seed: self.scenario.seed().get(),
            scenario: self.scenario.id().to_string(),
            contested: self.group.is_contested,
            bracket: BracketView::of(&self.scenario, &self.bracket),
            policy: self.policy.policy.to_string(),
            policy_version: self.row.policy_version,
            observations: match self.settings.observations {
                Observations::Telemetry => "telemetry",
                Observations::None => "none",
            },
            messages: if chat { "kept" } else { "none" },
            failed,
            episodes,
        }
    }
}
