//! Creating, pausing and resuming runs.

use env_core::{SEED_WANTED, Seed};

use super::queue;
use super::settings::{RunSettings, RunWish};
use super::{Change, Happening, TrainingError, Work};
use crate::ids::{RunId, random_seed, random_token};
use crate::store::runs::{self, RunRow};
use crate::store::{signed, to_json};

/// Longest name of a run, in characters.
const MAX_NAME: usize = 200;

/// Creates a run.
#[derive(Debug)]
pub struct CreateRun {
    id: RunId,
    name: String,
    seed: u64,
    settings: RunSettings,
}

impl CreateRun {
    /// Reads a wish.
    ///
    /// # Errors
    /// The field at fault.
    pub fn read(wish: &RunWish) -> Result<Self, TrainingError> {
        let id: RunId = match &wish.id {
            Some(id) => {
                id.parse().map_err(|e: crate::ids::BadId| TrainingError::invalid("id", e.to_string()))?
            }
            None => format!("run-{}", random_token(8))
                .parse()
                .map_err(|e: crate::ids::BadId| TrainingError::invalid("id", e.to_string()))?,
        };
        let name = wish.name.clone().unwrap_or_else(|| id.to_string());
        if name.is_empty() || name.chars().count() > MAX_NAME {
            return Err(TrainingError::invalid("name", format!("it must have 1 to {MAX_NAME} characters")));
        }
        let seed = wish.seed.unwrap_or_else(random_seed);
        // One bound for every seed that people choose.
        Seed::user(seed).map_err(|_| {
            TrainingError::invalid("seed", format!("it is {seed}, but must be {SEED_WANTED}"))
        })?;
        Ok(Self { id, name, seed, settings: RunSettings::read(wish)? })
    }
}

impl Change for CreateRun {
    type Answer = RunRow;

    async fn apply(self, work: &mut Work) -> Result<RunRow, TrainingError> {
        let row = RunRow {
            id: self.id.to_string(),
            name: self.name,
            seed: signed(self.seed),
            status: "active".to_owned(),
            settings: to_json(&self.settings)?,
            policy_version: 0,
            created_at: work.now,
        };
        if !runs::insert(&mut work.conn, &row).await? {
            return Err(TrainingError::RunExists(row.id));
        }
        queue::fill(work, &row.id, queue::AHEAD).await?;
        work.tell(&row.id, &Happening::Run { state: "created" })?;
        Ok(row)
    }
}

/// Pauses or resumes a run. A paused run grants no leases; results of leases it has granted are still taken.
#[derive(Debug)]
pub struct SetPaused {
    /// Which.
    pub run: RunId,
    /// Whether it should be paused.
    pub paused: bool,
}

impl Change for SetPaused {
    type Answer = RunRow;

    async fn apply(self, work: &mut Work) -> Result<RunRow, TrainingError> {
        let run = self.run.as_str();
        let (mind, conn) = work.mind(run).await?;
        mind.paused = self.paused;
        runs::set_status(conn, run, if self.paused { "paused" } else { "active" }).await?;
        let row = runs::get(conn, run).await?.ok_or_else(|| TrainingError::UnknownRun(run.to_owned()))?;
        work.wake_prepare();
        work.wake_rollout();
        let state = if self.paused { "paused" } else { "resumed" };
        work.tell(run, &Happening::Run { state })?;
        Ok(row)
    }
}

/// Says which policy version is the newest: what trainers report raises it by itself, and a wrong one stays until it is set.
#[derive(Debug)]
pub struct SetNewest {
    /// Of which run.
    pub run: RunId,
    /// The version.
    pub policy_version: u32,
}

impl Change for SetNewest {
    type Answer = RunRow;

    async fn apply(self, work: &mut Work) -> Result<RunRow, TrainingError> {
        let run = self.run.as_str();
        let (mind, conn) = work.mind(run).await?;
        mind.policy_version = i64::from(self.policy_version);
        runs::set_policy_version(conn, run, mind.policy_version).await?;
        runs::get(conn, run).await?.ok_or_else(|| TrainingError::UnknownRun(run.to_owned()))
    }
}
