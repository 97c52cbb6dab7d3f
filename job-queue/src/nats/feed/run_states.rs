//! States of runs in a key-value bucket, for programs that watch them, such as workers with rollouts.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use async_nats::jetstream::Context;
use async_nats::jetstream::kv::{Config, Entry, Operation, Store};
use futures_util::StreamExt;
use serde::{Deserialize, Serialize};

use super::presence::ServersOfCluster;
use crate::nats::connection::NatsError;
use crate::nats::names::ClusterName;

/// Time in which JetStream must return the states that a bucket has.
const READ_TIMEOUT: Duration = Duration::from_secs(10);
/// Beginning of the keys of runs.
const KEY_PREFIX: &str = "runs.";

/// State of a run: the value of the key `runs.<id>`, as JSON.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PublishedRunState {
    /// `active`, `paused` or `archived`.
    pub state: String,
    /// Newest policy version that a trainer reported.
    pub policy_version: i64,
    /// Policy that the server rolls out, or `off`.
    pub policy: String,
    /// Version of this policy.
    pub version: i64,
    /// When the run was created, milliseconds since the epoch.
    pub created_at: i64,
    /// Name of the server of the run.
    #[serde(default)]
    pub server: String,
}

/// Bucket of the states of all runs of all servers with one name.
pub struct RunStateBucket {
    store: Store,
    server: String,
    servers: ServersOfCluster,
    /// States in the bucket, by run.
    known: BTreeMap<String, PublishedRunState>,
}

impl std::fmt::Debug for RunStateBucket {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RunStateBucket").field("server", &self.server).finish_non_exhaustive()
    }
}

impl RunStateBucket {
    /// Opens the bucket, which is created if it does not exist, and reads its states.
    pub(super) async fn open(
        context: &Context,
        servers: ServersOfCluster,
        server: String,
    ) -> Result<Self, NatsError> {
        let config = Config {
            bucket: servers.cluster().run_states_bucket(),
            description: "Sparring: states and policy versions of runs".to_owned(),
            history: 1,
            ..Config::default()
        };
        let store = context.create_or_update_key_value(config).await;
        let store = store.map_err(|error| NatsError::new("the states of runs cannot be opened", error))?;
        let read = tokio::time::timeout(READ_TIMEOUT, read_states(&store)).await;
        let known = read.map_err(|error| NatsError::new("the states of runs cannot be read", error))??;
        Ok(Self { store, server, servers, known })
    }

    /// Returns the servers that run and write the same runs, from copies of the database.
    async fn running_copies(
        &self,
        states: &BTreeMap<String, PublishedRunState>,
    ) -> Result<BTreeSet<String>, NatsError> {
        let same_runs = states.iter().filter_map(|(run, state)| {
            self.known
                .get(run)
                .filter(|known| known.server != self.server && known.created_at == state.created_at)
        });
        let copies: BTreeSet<&String> = same_runs.map(|known| &known.server).collect();
        let mut running = BTreeSet::new();
        for server in copies {
            if self.servers.is_running(server).await? {
                running.insert(server.clone());
            }
        }
        Ok(running)
    }

    /// Writes the states that differ from those in the bucket, and deletes those of runs that this server no longer has. Returns true if
    /// a server with a copy of the database keeps some: they are to be written once it has ended.
    ///
    /// # Errors
    /// Returns [`NatsError`] if JetStream fails.
    pub async fn update(&mut self, states: BTreeMap<String, PublishedRunState>) -> Result<bool, NatsError> {
        let failed =
            |error: &dyn std::fmt::Display| NatsError::new("the state of a run cannot be written", error);
        let is_gone = |run: &String, known: &PublishedRunState| {
            known.server == self.server && !states.contains_key(run)
        };
        let gone: BTreeSet<String> = self
            .known
            .iter()
            .filter(|(run, known)| is_gone(run, known))
            .map(|(run, _)| run.clone())
            .collect();
        for run in gone {
            self.store.purge(format!("{KEY_PREFIX}{run}")).await.map_err(|error| failed(&error))?;
            self.known.remove(&run);
        }
        let copies = self.running_copies(&states).await?;
        for (run, state) in states {
            let state = PublishedRunState { server: self.server.clone(), ..state };
            let known = self.known.get(&run);
            // Another server has a run of the same id, or a copy of the database: the first one keeps the key.
            let is_foreign = known.is_some_and(|known| {
                known.server != self.server
                    && (known.created_at != state.created_at || copies.contains(&known.server))
            });
            if is_foreign || known == Some(&state) {
                continue;
            }
            let json = serde_json::to_vec(&state).map_err(|error| failed(&error))?;
            self.store
                .put(format!("{KEY_PREFIX}{run}"), json.into())
                .await
                .map_err(|error| failed(&error))?;
            self.known.insert(run, state);
        }
        Ok(!copies.is_empty())
    }
}

/// Reads the states that a bucket has.
async fn read_states(store: &Store) -> Result<BTreeMap<String, PublishedRunState>, NatsError> {
    let failed = |error: &dyn std::fmt::Display| NatsError::new("the states of runs cannot be read", error);
    let mut known = BTreeMap::new();
    if store.status().await.map_err(|error| failed(&error))?.values() == 0 {
        return Ok(known);
    }
    let mut entries = store.watch_with_history(">").await.map_err(|error| failed(&error))?;
    while let Some(entry) = entries.next().await {
        let entry = entry.map_err(|error| failed(&error))?;
        // A value of another form is written again.
        known.extend(run_of(&entry).zip(state_of(&entry)));
        if entry.seen_current {
            break;
        }
    }
    Ok(known)
}

/// Passes the states of all runs to `note`, and then every change; `None` for a run that is gone. It returns only with an error.
pub(crate) async fn follow_run_states(
    context: &Context,
    cluster: &ClusterName,
    note: impl Fn(String, Option<PublishedRunState>),
) -> Result<(), NatsError> {
    let failed =
        |error: &dyn std::fmt::Display| NatsError::new("the states of runs cannot be followed", error);
    let store = context.get_key_value(cluster.run_states_bucket()).await.map_err(|error| failed(&error))?;
    let mut entries = store.watch_with_history(">").await.map_err(|error| failed(&error))?;
    while let Some(entry) = entries.next().await {
        let entry = entry.map_err(|error| failed(&error))?;
        if let Some(run) = run_of(&entry) {
            note(run, state_of(&entry));
        }
    }
    Err(NatsError::Failed("the states of runs ended".to_owned()))
}

/// Returns the run of an entry; `None` if its key is no run's.
fn run_of(entry: &Entry) -> Option<String> {
    entry.key.strip_prefix(KEY_PREFIX).map(str::to_owned)
}

/// Returns the state of an entry; `None` if it was deleted or has another form.
fn state_of(entry: &Entry) -> Option<PublishedRunState> {
    if entry.operation == Operation::Put { serde_json::from_slice(&entry.value).ok() } else { None }
}
