//! Creating runs.

use env_core::{SEED_REQUIREMENT, Seed};

use crate::leases::create::OwnerQuota;
use crate::leases::proposal_queue;
use crate::runs::settings::{RunSettings, RunRequest};
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;
use crate::ids::{RunId, random_seed, random_token};
use crate::store::runs::{self, RunRow, RunStatus};
use crate::store::{to_i64, to_json, tokens};

/// Longest name of a run, in characters.
const MAX_NAME: usize = 200;

/// Creates a run.
#[derive(Debug)]
pub struct CreateRun {
    id: RunId,
    name: String,
    seed: u64,
    settings: RunSettings,
    /// Whose it will be, where a token is needed.
    owner: Option<OwnerQuota>,
}

impl CreateRun {
    /// Reads a wish.
    ///
    /// # Errors
    /// The field at fault.
    pub fn read(wish: &RunRequest) -> Result<Self, ServiceError> {
        let id: RunId = match &wish.id {
            Some(id) => {
                id.parse().map_err(|e: crate::ids::InvalidId| ServiceError::invalid("id", e.to_string()))?
            }
            None => format!("run-{}", random_token(8))
                .parse()
                .map_err(|e: crate::ids::InvalidId| ServiceError::invalid("id", e.to_string()))?,
        };
        let name = wish.name.clone().unwrap_or_else(|| id.to_string());
        named(&name)?;
        let seed = wish.seed.unwrap_or_else(random_seed);
        // One bound for every seed that people choose.
        Seed::user(seed).map_err(|_| {
            ServiceError::invalid("seed", format!("it is {seed}, but must be {SEED_REQUIREMENT}"))
        })?;
        Ok(Self { id, name, seed, settings: RunSettings::read(wish)?, owner: None })
    }

    /// The same, for who it will be.
    #[must_use]
    pub fn of(self, owner: Option<OwnerQuota>) -> Self {
        Self { owner, ..self }
    }
}

/// A name, if it is one.
pub(crate) fn named(name: &str) -> Result<&str, ServiceError> {
    if name.is_empty() || name.chars().count() > MAX_NAME {
        return Err(ServiceError::invalid("name", format!("it must have 1 to {MAX_NAME} characters")));
    }
    Ok(name)
}

impl Change for CreateRun {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let row = RunRow {
            id: self.id.to_string(),
            name: self.name,
            seed: to_i64(self.seed),
            status: RunStatus::Active,
            settings: to_json(&self.settings)?,
            policy_version: 0,
            created_at: tx.now,
            archived_at: None,
        };
        if let Some(OwnerQuota { token, max }) = self.owner
            && tokens::count_runs(&mut tx.conn, token).await? >= i64::from(max)
        {
            return Err(ServiceError::TooManyRuns(max));
        }
        if !runs::insert(&mut tx.conn, &row, self.owner.map(|owner| owner.token)).await? {
            return Err(ServiceError::RunExists(row.id));
        }
        proposal_queue::fill(&mut tx.run(&row.id).await?, proposal_queue::QUEUE_TARGET).await?;
        tx.emit(&row.id, &RunEvent::Run { state: "created" })?;
        Ok(row)
    }
}
