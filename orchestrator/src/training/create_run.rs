//! Creating runs.

use env_core::{SEED_WANTED, Seed};

use super::lease::Owner;
use super::queue;
use super::settings::{RunSettings, RunWish};
use super::{Change, Happening, TrainingError, Work};
use crate::ids::{RunId, random_seed, random_token};
use crate::store::runs::{self, RunRow};
use crate::store::{signed, to_json, tokens};

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
    owner: Option<Owner>,
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
        named(&name)?;
        let seed = wish.seed.unwrap_or_else(random_seed);
        // One bound for every seed that people choose.
        Seed::user(seed).map_err(|_| {
            TrainingError::invalid("seed", format!("it is {seed}, but must be {SEED_WANTED}"))
        })?;
        Ok(Self { id, name, seed, settings: RunSettings::read(wish)?, owner: None })
    }

    /// The same, for who it will be.
    #[must_use]
    pub fn of(self, owner: Option<Owner>) -> Self {
        Self { owner, ..self }
    }
}

/// A name, if it is one.
pub(super) fn named(name: &str) -> Result<&str, TrainingError> {
    if name.is_empty() || name.chars().count() > MAX_NAME {
        return Err(TrainingError::invalid("name", format!("it must have 1 to {MAX_NAME} characters")));
    }
    Ok(name)
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
            archived_at: None,
        };
        if let Some(Owner { token, most }) = self.owner
            && tokens::runs(&mut work.conn, token).await? >= i64::from(most)
        {
            return Err(TrainingError::TooManyRuns(most));
        }
        if !runs::insert(&mut work.conn, &row, self.owner.map(|owner| owner.token)).await? {
            return Err(TrainingError::RunExists(row.id));
        }
        queue::fill(work, &row.id, queue::AHEAD).await?;
        work.tell(&row.id, &Happening::Run { state: "created" })?;
        Ok(row)
    }
}
