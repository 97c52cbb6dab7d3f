//! A leased group: what it takes to fly it, and what is told of it once it was flown.

use env_core::{Bracket, Scenario};

use super::body::{TrajectoryEpisode, TrajectoryGroup};
use super::fly::{Outcome, Room};
use super::settings::{Observations, PolicySettings};
use crate::frames::wire_step;
use crate::ids::{EpisodeId, LayoutId, LeaseId, RunId};
use crate::store::groups::{self, GroupRow};
use crate::store::leases::LeaseRow;
use crate::store::policies::PolicyRow;
use crate::store::scenarios::Loader;
use crate::store::{StoreError, brackets, from_json, runs, small, to_json, unsigned};
use crate::training::audit::{Audited, Claim, Claimed, Verdict};
use crate::training::{BracketView, Desk, RunSettings, TrainingError};

/// A group that cannot be flown or told of.
#[derive(Debug, thiserror::Error)]
pub enum FlyError {
    /// It was not taken, or not counted.
    #[error(transparent)]
    Training(#[from] TrainingError),
    /// It cannot be kept.
    #[error(transparent)]
    Body(#[from] super::body::BodyError),
    /// A thread that flew it ended.
    #[error("what flew it ended: {0}")]
    Thread(String),
}

/// A leased group with all that is needed to fly it.
#[derive(Debug)]
pub struct Ground {
    /// Its run.
    pub run: RunId,
    /// Its lease.
    pub lease: LeaseId,
    /// The policy that flies it.
    pub policy: PolicyRow,
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

impl Ground {
    /// Reads what was leased.
    ///
    /// # Errors
    /// The store's.
    pub async fn load(
        desk: &Desk,
        run: RunId,
        lease: LeaseId,
        policy: PolicyRow,
    ) -> Result<Self, TrainingError> {
        let mut conn = desk.readers.acquire().await?;
        let row = crate::training::lease::find(&mut conn, &run, &lease).await?;
        let gone = || StoreError::unreadable("a lease", "it has no group");
        let group = groups::get(&mut conn, row.id, 0).await?.ok_or_else(gone)?;
        let scenario = Loader::default().get(&mut conn, &group.scenario).await?;
        let bracket = brackets::newest(&mut conn, &group.scenario).await?;
        let bracket = bracket
            .ok_or_else(|| StoreError::unreadable("a bracket", "there is none for a leased scenario"))?;
        let stored = runs::get(&mut conn, run.as_str()).await?;
        let stored = stored.ok_or_else(|| TrainingError::UnknownRun(run.to_string()))?;
        let told: RunSettings = from_json("a run's settings", &stored.settings)?;
        Ok(Self {
            settings: PolicySettings::of(&policy)?,
            enough: told.enough(small(row.group_size)) as usize,
            run_seed: unsigned(stored.seed),
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
        small(self.row.group_size)
    }

    /// Room for what is kept of them.
    #[must_use]
    pub fn room(&self) -> Room {
        Room::new(self.settings.observations == Observations::Telemetry)
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
    pub fn claims(&self, outcomes: &[Outcome]) -> Result<Vec<Claim>, TrainingError> {
        let claim = |(index, outcome): (usize, &Outcome)| {
            let what = match &outcome.flight {
                Ok(flight) => Claimed::Finished {
                    steps: flight.log.steps().map(|step| wire_step(&flight.log, step)).collect(),
                    precision: flight.log.precision(),
                    stopped: flight.log.stopped,
                },
                Err(reason) => Claimed::Failed { reason: reason.clone() },
            };
            let metrics = outcome.metrics.map(|metrics| to_json(&metrics)).transpose()?;
            Ok(Claim { episode: self.episode(index), what, policy_version: None, metrics })
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
        outcomes: Vec<Outcome>,
        audited: &[Audited],
        room: &Room,
    ) -> Result<Option<TrajectoryGroup>, TrainingError> {
        let failed = outcomes.iter().filter(|outcome| outcome.flight.is_err()).count();
        let flown = outcomes.len() - failed;
        if flown == 0 || flown < self.enough || self.group.train == 0 {
            return Ok(None);
        }
        let chat = outcomes.iter().any(|outcome| outcome.metrics.is_some());
        let mut episodes = Vec::with_capacity(flown);
        for (outcome, audited) in outcomes.into_iter().zip(audited) {
            let Ok(flight) = outcome.flight else { continue };
            let (score, skill, success) = match &audited.verdict {
                Verdict::Flown { flown, skill, success, .. } => (flown.score, *skill, *success),
                Verdict::Failed(reason) | Verdict::Refused { detail: reason, .. } => {
                    return Err(TrainingError::invalid("rollout", format!("{}: {reason}", audited.episode)));
                }
                Verdict::Known { .. } => return Err(TrainingError::Expired(audited.episode.clone())),
            };
            episodes.push(TrajectoryEpisode {
                id: audited.episode.clone(),
                score,
                skill,
                success,
                stopped: flight.log.stopped.map(env_core::Stopped::word),
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
            role: self.group.role.clone(),
            layout: self.group.layout.map(|id| LayoutId(id).to_string()),
            recipe: self.scenario.recipe().to_json(),
            seed: self.scenario.seed().get(),
            scenario: self.scenario.id().to_string(),
            contested: self.group.contested != 0,
            bracket: BracketView::of(&self.scenario, &self.bracket),
            policy: self.policy.policy.clone(),
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
