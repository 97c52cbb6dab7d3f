//! Creates runs from requests.

use std::collections::BTreeSet;

use api_types::RunRequest;
use env_core::{SEED_REQUIREMENT, Seed};
use store::ids::{InvalidId, RunId, random_seed};
use store::name_set::NameSet;
use store::principals;
use store::run_tags::{self, RunTag};
use store::runs::{self, RunRow, RunStatus};
use store::{to_i64, to_json};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;
use crate::leases::create::OwnerQuota;
use crate::leases::proposal_queue;
use crate::leases::slots::open_undisclosed;
use crate::runs::set_tags::parse_tags;
use crate::runs::settings::RunSettings;
use crate::runs::validate::{check_run_name, check_run_note};
use crate::shards::Shards;

/// Creates a run and fills its proposal queue.
#[derive(Debug)]
pub struct CreateRun {
    id: RunId,
    name: String,
    seed: u64,
    settings: RunSettings,
    tags: BTreeSet<RunTag>,
    note: String,
    /// Owner of the run; set when token authentication is on.
    owner: Option<OwnerQuota>,
}

impl CreateRun {
    /// Checks a request, and generates the id and the seed that it leaves out. The id has the shard of this server.
    ///
    /// # Errors
    /// Returns an error that names the first invalid field.
    pub fn from_request(request: &RunRequest, shards: &Shards) -> Result<Self, ServiceError> {
        let id = match &request.id {
            Some(id) => parse_new_id(id, shards)?,
            None => RunId::generate(shards.own()),
        };
        let name = request.name.clone().unwrap_or_else(|| id.to_string());
        check_run_name(&name)?;
        check_run_note(&request.note)?;
        let seed = request.seed.unwrap_or_else(random_seed);
        // Every seed that a client chooses has the same bound.
        Seed::user(seed)
            .map_err(|_| ServiceError::invalid("seed", format!("must be {SEED_REQUIREMENT}, got {seed}")))?;
        let (settings, tags) = (RunSettings::try_from(request)?, parse_tags(&request.tags)?);
        Ok(Self { id, name, seed, settings, tags, note: request.note.clone(), owner: None })
    }

    /// Returns the change with an owner for the run.
    #[must_use]
    pub fn owned_by(self, owner: Option<OwnerQuota>) -> Self {
        Self { owner, ..self }
    }
}

/// Parses the id of a new run, which must begin with the shard of this server if it has one.
fn parse_new_id(text: &str, shards: &Shards) -> Result<RunId, ServiceError> {
    let id: RunId =
        text.parse().map_err(|error: InvalidId| ServiceError::invalid("id", error.to_string()))?;
    let reason = match (id.shard(), shards.own()) {
        (shard, own) if shard.as_ref() == own => return Ok(id),
        (Some(shard), None) => {
            format!("must not begin with the shard {shard} and a dot, because this server has no shard")
        }
        (None, Some(_)) => {
            let choices: Vec<String> = shards.names().map(|shard| format!("{shard}.{id}")).collect();
            format!("must begin with a shard, so that a proxy finds the run: {}", choices.join(" or "))
        }
        (Some(_), Some(own)) => {
            format!(
                "must begin with {own}, the shard of this server, or with the shard of a peer, got {text}"
            )
        }
        (None, None) => return Ok(id),
    };
    Err(ServiceError::invalid("id", reason))
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
            paused_at: None,
            is_seed_reused: runs::record_seed(&mut tx.conn, to_i64(self.seed)).await?,
            tags: NameSet::default(),
            owner: None,
            members: NameSet::default(),
            note: self.note,
            episodes: 0,
            skill: None,
            first_results_at: None,
            last_results_at: None,
        };
        if let Some(OwnerQuota { principal, max: Some(max) }) = self.owner
            && principals::count_runs(&mut tx.conn, principal).await? >= i64::from(max)
        {
            return Err(ServiceError::TooManyRuns(max));
        }
        if !runs::insert(&mut tx.conn, &row, self.owner.map(|owner| owner.principal)).await? {
            let exists = runs::exists(&mut tx.conn, &row.id).await?;
            return Err(if exists {
                ServiceError::RunExists(row.id)
            } else {
                ServiceError::RunBeingDeleted(row.id)
            });
        }
        if row.is_seed_reused {
            mark_twins(tx, row.seed).await?;
        }
        run_tags::replace(&mut tx.conn, &row.id, &self.tags).await?;
        let mut run = tx.run(&row.id).await?;
        proposal_queue::fill(&mut run).await?;
        run.outbox.signal(Signal::RunStates);
        run.emit(&RunEvent::Run { state: "created" })?;
        runs::get(run.conn, &row.id).await?.ok_or(ServiceError::UnknownRun(row.id))
    }
}

/// Marks the earlier runs with the seed of a new run: the new run shows their scenarios.
async fn mark_twins(tx: &mut WriteTx, seed: i64) -> Result<(), ServiceError> {
    for run in runs::mark_seed_reused(&mut tx.conn, seed).await? {
        let mut run = tx.run(&run).await?;
        run.state.is_seed_reused = true;
        open_undisclosed(&mut run).await?;
    }
    Ok(())
}
