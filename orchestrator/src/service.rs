//! The service as a whole: database, writer, workers, HTTP; started and stopped together.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use sqlx::{SqliteConnection, SqlitePool};
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::task::{JoinHandle, JoinSet};

use crate::clock::Clock;
use crate::http;
use crate::judging::{Judges, ModelJudge};
use crate::sessions::{Limits, Seats, Sessions};
use crate::store::{
    Claim, OpenError, StoreError, asks, claim, folder, policies, reader, tokens, unsigned, verdicts, writer,
};
use crate::threads::{self, Priority};
use crate::training::design::{BuiltIn, Designers};
use crate::training::rollout::Endpoint;
use crate::training::{Desk, Wakes, Writer};
use crate::workers;

/// Batches of results that are parsed and replayed at once: each may take a few hundred MiB while it is.
const LARGE_BODIES: usize = 3;
/// How many may listen to events at once; of each a quarter.
const LISTENERS: usize = 256;
/// How long requests may still run when the service stops.
const GRACE: Duration = Duration::from_secs(10);

/// What to start.
#[derive(Debug, Clone)]
pub struct Config {
    /// Where to listen; port 0 takes a free one.
    pub bind: SocketAddr,
    /// The database file; made where there is none.
    pub db: PathBuf,
    /// Where the time is read.
    pub clock: Clock,
    /// Who designs layouts.
    pub designers: Arc<dyn Designers>,
    /// How many may fly on the server, and for how long without a word.
    pub sessions: Limits,
    /// Who judges their steps.
    pub judges: Arc<Judges>,
    /// The language model that flies for runs whose policy is `chat`, where there is one.
    pub endpoint: Option<Endpoint>,
    /// Whether OpenEnv's routes are for anybody. Where there are no tokens they are then all that is shown.
    pub openenv_public: bool,
    /// What each who comes in may do at most.
    pub each: http::Each,
}

impl Config {
    /// On loopback, on a free port.
    #[must_use]
    pub fn local(db: PathBuf) -> Self {
        Self {
            bind: SocketAddr::from(([127, 0, 0, 1], 0)),
            db,
            clock: Clock::system(),
            designers: Arc::new(BuiltIn),
            sessions: Limits::default(),
            judges: Arc::default(),
            endpoint: None,
            openenv_public: false,
            each: http::Each::default(),
        }
    }
}

/// Why the service could not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The database.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// What was left open could not be closed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The address is one that others reach, and there are no tokens to keep strangers out.
    #[error(
        "{0} is reachable by others, and there are no tokens to keep strangers out: make one by `sparring token create`, bind a loopback address, as 127.0.0.1:8700, or show OpenEnv's routes alone by --openenv-public"
    )]
    Public(SocketAddr),
    /// The same, and none of the tokens that there are lets anybody in.
    #[error(
        "{0} is reachable by others, and every token has expired or was revoked (`sparring token list` shows them): make one by `sparring token create`"
    )]
    Expired(SocketAddr),
    /// The system gives no threads.
    #[error("no threads to work in the background: {0}")]
    Threads(rayon::ThreadPoolBuildError),
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {reason}")]
    Listen {
        /// Where.
        address: SocketAddr,
        /// Why.
        reason: std::io::Error,
    },
}

/// What every request handler can reach.
#[derive(Debug, Clone)]
pub struct App {
    /// The one writer.
    pub writer: Writer,
    /// Connections that read.
    pub readers: SqlitePool,
    /// Where the time is read.
    pub clock: Clock,
    /// What each who comes in may do at most.
    pub each: http::Each,
    /// Hands out leases and takes results.
    pub desk: Desk,
    /// Who flies on the server.
    pub sessions: Arc<Sessions>,
    /// Whether OpenEnv is for anybody, and the rest is not.
    pub openenv_public: bool,
    /// What web sessions show to whoever looks.
    pub boards: Arc<http::Boards>,
    /// For batches of results and columns.
    pub room: http::Room,
    /// Moves whenever something that is told of a run was committed.
    pub events: Arc<watch::Sender<u64>>,
    /// Who listens to that.
    pub listeners: Arc<Seats>,
    /// How much of what takes a while is done at once.
    pub turns: http::AllTurns,
    /// Who designs layouts.
    pub designers: Arc<dyn Designers>,
    /// Who judges the steps of sessions.
    pub judges: Arc<Judges>,
    /// The language model that flies, where there is one.
    pub endpoint: Option<Endpoint>,
    /// Who waits for groups that were flown.
    pub polls: http::Polls,
    /// Whether the database could be written when it was last looked.
    pub looked: http::Looked,
    /// The service is going down.
    pub stopping: Arc<AtomicBool>,
}

/// A running service.
#[derive(Debug)]
pub struct Service {
    address: SocketAddr,
    stopping: Arc<AtomicBool>,
    stop: watch::Sender<bool>,
    sessions: Arc<Sessions>,
    server: JoinHandle<()>,
    workers: JoinSet<()>,
    fold: JoinHandle<()>,
    writer: JoinHandle<()>,
    readers: SqlitePool,
    claim: Arc<Claim>,
}

impl Service {
    /// Opens the database, starts the workers, and listens.
    ///
    /// # Errors
    /// Why it could not start.
    pub async fn start(config: Config) -> Result<Self, StartError> {
        http::begin_counting();
        let (listener, address) = listen(&config).await?;
        let (claim, surface, connection) = open(&config).await?;
        let readers = reader(&config.db).await?;

        let wakes = Wakes::default();
        let (writer, writer_task) =
            Writer::start((connection, Some(Arc::clone(&claim))), config.clock.clone(), wakes.clone());
        let (ready_tx, ready) = watch::channel(0);
        let events = Arc::clone(&wakes.events);
        let (stopping, (stop, stopped)) = (Arc::<AtomicBool>::default(), watch::channel(false));
        let polls = http::Polls::new(wakes.feed.subscribe(), stopped.clone());
        let desk = Desk {
            writer: writer.clone(),
            readers: readers.clone(),
            ready,
            gates: Arc::default(),
            replaying: pool("replay", 0, Priority::Bulk)?,
        };
        let sessions = sessions(&config, surface, &desk)?;
        let jobs = employ(&config, &desk, (wakes, ready_tx), &sessions)?;
        let seen = (readers.clone(), writer.clone(), config.clock.clone());
        let gate = http::Gate::new(seen, address, config.openenv_public, config.each);
        let app = App {
            writer,
            readers: readers.clone(),
            clock: config.clock,
            each: config.each,
            desk,
            sessions: Arc::clone(&sessions),
            openenv_public: config.openenv_public,
            boards: Arc::default(),
            room: http::Room::new(LARGE_BODIES),
            events,
            listeners: Arc::new(Seats::new(LISTENERS, LISTENERS / 4)),
            turns: http::AllTurns::default(),
            designers: config.designers,
            judges: config.judges,
            endpoint: config.endpoint,
            polls,
            looked: http::Looked::default(),
            stopping: Arc::clone(&stopping),
        };
        let fold = tokio::spawn(workers::fold::run(folder(&config.db).await?, stopped.clone()));
        let routes = http::router(app, Arc::new(gate), surface);
        let server = tokio::spawn(http::serve(listener, routes, stopped));
        Ok(Self {
            address,
            stopping,
            stop,
            sessions,
            server,
            workers: jobs,
            fold,
            writer: writer_task,
            readers,
            claim,
        })
    }

    /// Where it listens.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Where it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Stops: no new requests, those running are finished, workers end, snapshots are taken, the database closes.
    pub async fn stop(mut self) {
        self.stopping.store(true, Ordering::SeqCst);
        self.stop.send_replace(true);
        self.sessions.close().await;
        if tokio::time::timeout(GRACE, &mut self.server).await.is_err() {
            tracing::warn!("Some requests did not end in time and were cut off.");
            self.server.abort();
            let _ = self.server.await;
        }
        // Workers hold nothing that is not in the store: they are cut off, and what they did twice is done once.
        self.workers.shutdown().await;
        if let Err(error) = self.fold.await {
            tracing::error!(error = %error, "The worker that folds the log did not end well.");
        }
        // The writer ends when nobody is left who could ask it for something.
        drop(self.sessions);
        match tokio::time::timeout(GRACE, self.writer).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => tracing::error!(error = %error, "The writer did not end well."),
            Err(_) => {
                tracing::warn!("Somebody still holds on to the writer; what was acknowledged is stored.");
            }
        }
        self.readers.close().await;
        drop(self.claim);
    }

    /// Waits for the writer to end by itself, which it does only when something is broken beyond repair: nothing can be
    /// written any more, and a process that goes on would only look alive.
    pub async fn broken(&mut self) {
        if let Err(error) = (&mut self.writer).await {
            tracing::error!(error = %error, "The writer failed.");
        }
    }
}

/// What was left when the service went away, before anybody can look.
async fn pick_up(config: &Config, connection: &mut SqliteConnection) -> Result<(), StoreError> {
    // What was running is not any more.
    let interrupted = asks::interrupt(connection, config.clock.now()).await?;
    if interrupted > 0 {
        tracing::info!(
            interrupted,
            "Designers were being asked when the server went away; those asks failed."
        );
    }
    for row in asks::spent(connection).await? {
        config.designers.restore(&row.run, unsigned(row.tokens), row.cost, row.day);
    }
    if let Some(judge) = config.judges.model() {
        for row in verdicts::spent(connection).await? {
            let run = ModelJudge::payer((!row.run.is_empty()).then_some(row.run.as_str()));
            judge.llm().restore(run, unsigned(row.tokens), row.cost, row.day);
        }
    }
    if let Some(endpoint) = &config.endpoint {
        for row in policies::spent(connection).await? {
            endpoint.llm.restore(&row.run, unsigned(row.tokens), row.cost, row.day);
        }
    }
    Ok(())
}

/// What is shown: everything where whoever comes in is known, or is on this machine.
async fn surface(config: &Config, connection: &mut SqliteConnection) -> Result<http::Surface, StartError> {
    let (any, valid) = tokens::any(connection, config.clock.now()).await?;
    match config.openenv_public {
        true if any => Ok(http::Surface::Whole),
        true => Ok(http::Surface::OpenEnv),
        false if valid || config.bind.ip().is_loopback() => Ok(http::Surface::Whole),
        false if any => Err(StartError::Expired(config.bind)),
        false => Err(StartError::Public(config.bind)),
    }
}

/// The database, for this server alone, and what is shown of it.
async fn open(config: &Config) -> Result<(Arc<Claim>, http::Surface, SqliteConnection), StartError> {
    let claim = Arc::new(claim(&config.db)?);
    let mut connection = writer(&config.db).await?;
    claim.opened();
    let surface = surface(config, &mut connection).await?;
    pick_up(config, &mut connection).await?;
    Ok((claim, surface, connection))
}

/// Whether a start that makes the database may be: one that would be refused for want of tokens makes none.
fn may_make(config: &Config) -> Result<(), StartError> {
    let private = config.openenv_public || config.bind.ip().is_loopback();
    if private || config.db.exists() { Ok(()) } else { Err(StartError::Public(config.bind)) }
}

/// Where it listens: port 0 has become one.
async fn listen(config: &Config) -> Result<(TcpListener, SocketAddr), StartError> {
    may_make(config)?;
    let bind = config.bind;
    let refused = |reason| StartError::Listen { address: bind, reason };
    let listener = TcpListener::bind(bind).await.map_err(refused)?;
    let address = listener.local_addr().map_err(refused)?;
    Ok((listener, address))
}

/// Where environments fly on the server; for runs only where there is more than OpenEnv's surface.
fn sessions(config: &Config, surface: http::Surface, desk: &Desk) -> Result<Arc<Sessions>, StartError> {
    let limits = Limits { runs: config.sessions.runs && surface == http::Surface::Whole, ..config.sessions };
    let flying = pool("fly", 0, Priority::Usual)?;
    Ok(Arc::new(Sessions::new(limits, desk.clone(), Arc::clone(&config.judges), flying)))
}

/// Starts the workers.
fn employ(
    config: &Config,
    desk: &Desk,
    (wakes, ready): (Wakes, watch::Sender<u64>),
    sessions: &Arc<Sessions>,
) -> Result<JoinSet<()>, StartError> {
    let Desk { writer, readers, .. } = desk;
    let mut jobs = JoinSet::new();
    let preparer = workers::prepare::Preparer {
        readers: readers.clone(),
        writer: writer.clone(),
        wake: wakes.prepare,
        ready,
        hopeless: Arc::default(),
        pool: pool("prepare", workers::prepare::AT_ONCE, Priority::Bulk)?,
    };
    jobs.spawn(preparer.run());
    jobs.spawn(workers::expire::run(writer.clone()));
    jobs.spawn(workers::clock::run(config.clock.clone(), writer.clone()));
    jobs.spawn(workers::retain::run(readers.clone(), writer.clone()));
    let evaluating = pool("evaluate", threads::half(), Priority::Background)?;
    jobs.spawn(workers::evaluate::run(readers.clone(), writer.clone(), evaluating));
    jobs.spawn(workers::passes::run(readers.clone(), config.clock.clone(), Arc::clone(sessions)));
    let critic = workers::critique::Critic {
        readers: readers.clone(),
        writer: writer.clone(),
        wake: wakes.critique,
        pool: pool("critique", threads::half(), Priority::Background)?,
    };
    jobs.spawn(critic.run());
    let studio = workers::design::Studio {
        readers: readers.clone(),
        writer: writer.clone(),
        wake: wakes.design,
        designers: Arc::clone(&config.designers),
    };
    jobs.spawn(studio.run());
    let pilots = workers::rollout::Pilots {
        desk: desk.clone(),
        readers: readers.clone(),
        clock: config.clock.clone(),
        wake: wakes.rollout,
        endpoint: config.endpoint.clone(),
        pool: pool("rollout", threads::half(), Priority::Background)?,
    };
    jobs.spawn(pilots.run());
    Ok(jobs)
}

/// Threads of this name, as many as there are cores if 0.
fn pool(name: &'static str, count: usize, priority: Priority) -> Result<Arc<rayon::ThreadPool>, StartError> {
    threads::pool(name, count, priority).map(Arc::new).map_err(StartError::Threads)
}
