//! The steps before the server listens: address, database, and recovery of what the last server left.

use std::net::SocketAddr;
use std::sync::Arc;

use llm::Spending;
use sqlx::SqliteConnection;
use store::shard;
use store::tokens::{self, TokenPresence};
use store::{DatabaseLock, StoreError, design_requests, llm_spend, open_writer, to_u64};
use tokio::net::TcpListener;

use super::config::{Config, StartError};
use crate::http::ApiSurface;
use crate::shards::Shards;
use llm_policy::judging::ModelJudge;

/// Database that was opened for this server.
pub(super) struct OpenDatabase {
    /// Lock that keeps other servers from the file.
    pub(super) lock: Arc<DatabaseLock>,
    /// Routes that the server may serve.
    pub(super) surface: ApiSurface,
    /// Shard of the server, and its peers.
    pub(super) shards: Arc<Shards>,
    /// Connection for the writer.
    pub(super) connection: SqliteConnection,
}

/// Listener with its address.
pub(super) struct BoundListener {
    pub(super) listener: TcpListener,
    /// Configured address with the port that was bound.
    pub(super) address: SocketAddr,
}

/// Binds the configured address.
///
/// # Errors
/// Returns [`StartError::NoTokens`] if a new database would be reachable by other hosts, and [`StartError::Listen`] if the
/// address cannot be bound.
pub(super) async fn listen(config: &Config) -> Result<BoundListener, StartError> {
    check_new_database(config)?;
    let failed = |reason| StartError::Listen { address: config.bind, reason };
    let listener = TcpListener::bind(config.bind).await.map_err(failed)?;
    let address = listener.local_addr().map_err(failed)?;
    Ok(BoundListener { listener, address })
}

/// Claims and opens the database, checks its tokens, and recovers what the last server left.
///
/// # Errors
/// Returns an error if the database is in use, cannot be opened or has another shard, or if the address needs tokens that do not
/// exist.
pub(super) async fn open_database(config: &Config) -> Result<OpenDatabase, StartError> {
    let lock = Arc::new(DatabaseLock::acquire(&config.db)?);
    let mut connection = open_writer(&config.db).await?;
    lock.watch_files();
    let surface = select_surface(config, &mut connection).await?;
    let shards = Arc::new(settle_shards(config, &mut connection).await?);
    if config.process_token.is_none() {
        recover(config, &mut connection).await?;
    }
    Ok(OpenDatabase { lock, surface, shards, connection })
}

/// Rejects a start that would create a database and then fail for want of tokens.
fn check_new_database(config: &Config) -> Result<(), StartError> {
    let needs_tokens = !config.openenv_public && !config.bind.ip().is_loopback();
    if needs_tokens && !config.db.exists() { Err(StartError::NoTokens(config.bind)) } else { Ok(()) }
}

/// Selects the routes: all of them if clients have tokens or are on this machine.
async fn select_surface(
    config: &Config,
    connection: &mut SqliteConnection,
) -> Result<ApiSurface, StartError> {
    let TokenPresence { any, valid } = tokens::presence(connection, config.clock.now()).await?;
    match config.openenv_public {
        true if any => Ok(ApiSurface::Whole),
        true => Ok(ApiSurface::OpenEnv),
        false if valid || config.bind.ip().is_loopback() => Ok(ApiSurface::Whole),
        false if any => Err(StartError::NoValidTokens(config.bind)),
        false => Err(StartError::NoTokens(config.bind)),
    }
}

/// Returns the shard of the server with its peers. A database remembers the first shard that its server was started with.
async fn settle_shards(config: &Config, connection: &mut SqliteConnection) -> Result<Shards, StartError> {
    let stored = shard::remembered(connection).await?;
    if let (Some(stored), Some(given)) = (&stored, &config.shard)
        && stored != given
    {
        let db = config.db.display().to_string();
        return Err(StartError::OtherShard { db, stored: stored.clone(), given: given.clone() });
    }
    let shards = Shards::new(stored.clone().or_else(|| config.shard.clone()), config.peers.clone())?;
    if let (None, Some(given)) = (stored, &config.shard) {
        shard::remember(connection, given).await?;
        tracing::info!(shard = %given, "New ids begin with the shard; earlier ids stay as they are.");
    }
    Ok(shards)
}

/// Fails the design requests that the last server did not finish, and restores what models have spent.
async fn recover(config: &Config, connection: &mut SqliteConnection) -> Result<(), StoreError> {
    let interrupted = design_requests::fail_interrupted(connection, config.clock.now()).await?;
    if interrupted > 0 {
        tracing::info!(interrupted, "Design requests failed because the server stopped while they ran.");
    }
    for row in llm_spend::of_designs(connection).await? {
        config.designers.restore(&row.run, to_u64(row.tokens), row.cost, row.day);
    }
    if let Some(judge) = config.judges.model() {
        for row in llm_spend::of_judge(connection).await? {
            let run = ModelJudge::budget_account((!row.run.is_empty()).then_some(row.run.as_str()));
            judge.llm().restore_spending(run, spending(row.tokens, row.cost), row.day);
        }
    }
    if let Some(endpoint) = &config.endpoint {
        for row in llm_spend::of_rollouts(connection).await? {
            endpoint.llm.restore_spending(&row.run, spending(row.tokens, row.cost), row.day);
        }
    }
    Ok(())
}

/// Converts the tokens and cost of a database row.
fn spending(tokens: i64, cost: f64) -> Spending {
    Spending { tokens: to_u64(tokens), cost }
}
