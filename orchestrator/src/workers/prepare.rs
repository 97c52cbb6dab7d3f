//! Turns waiting proposals into scenarios with brackets, in order and in parallel.

use std::collections::{BTreeMap, BTreeSet};
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::Duration;

use env_core::SeedSpace;
use sqlx::{SqliteConnection, SqlitePool};
use tokio::sync::{Notify, oneshot, watch};
use tokio::task::JoinSet;

use crate::metrics;
use crate::store::proposals::{self, UnpreparedProposal, unprepared};
use crate::store::{from_json, runs, to_i64, to_u64};
use crate::leases::prepare::{prepare, UnsolvableParams, Origin, Place, PrepareError, PreparedScenario, StorePrepared, Waits};
use crate::leases::scenario_cache::ScenarioCache;
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::runs::settings::RunSettings;
use curriculum::Proposal;

/// Proposals that are prepared at once, of all runs together. More than there are cores: a scenario that takes seconds must
/// not keep those that take milliseconds waiting, and the system shares the cores out among them.
pub const AT_ONCE: usize = 16;
/// Proposals that are looked through for some that may be begun.
const LOOK: i64 = 128;
/// How long it waits after a failure, and at most for a wake-up that was missed.
const PAUSE: Duration = Duration::from_secs(2);

/// What the worker needs.
#[derive(Debug, Clone)]
pub struct PrepareWorker {
    /// Where proposals are read.
    pub readers: SqlitePool,
    /// Where scenarios are written.
    pub writer: Writer,
    /// Rung when there is work.
    pub wake: Arc<Notify>,
    /// Told whenever some were stored, for leases that wait.
    pub ready: watch::Sender<u64>,
    /// Threads of its own, [`AT_ONCE`]: scenarios that are hard to find must not hold up the replay of results.
    pub pool: Arc<rayon::ThreadPool>,
    /// Params that are not worth looking under.
    pub hopeless: Arc<UnsolvableParams>,
}

/// What became of a proposal: run, number, and the scenario; none where there is none.
type Done = (String, i64, Option<PreparedScenario>);

/// What is being prepared.
#[derive(Default)]
struct Begun {
    jobs: JoinSet<Option<Done>>,
    /// Which, run by run, until they are stored.
    of: BTreeMap<String, BTreeSet<i64>>,
}

impl Begun {
    /// Whether this one may be begun now, where a run may have so many under way.
    fn takes(&self, waiting: &UnpreparedProposal, most: usize) -> bool {
        let of = self.of.get(&waiting.run);
        self.jobs.len() < AT_ONCE
            && of.is_none_or(|begun| begun.len() < most && !begun.contains(&waiting.seq))
    }

    /// How many a run may have under way: its share, and room is left for one run more, so that whoever comes next finds
    /// some however long the others take.
    fn share(&self, waiting: &[UnpreparedProposal]) -> usize {
        let runs: BTreeSet<&String> = self.of.keys().chain(waiting.iter().map(|w| &w.run)).collect();
        (AT_ONCE / (runs.len() + 1)).max(1)
    }

    fn forget(&mut self, run: &str, seq: i64) {
        if let Some(begun) = self.of.get_mut(run) {
            begun.remove(&seq);
            if begun.is_empty() {
                self.of.remove(run);
            }
        }
    }
}

impl PrepareWorker {
    /// Works until the writer is gone.
    pub async fn run(self) {
        let mut begun = Begun::default();
        loop {
            match self.turn(&mut begun).await {
                Ok(()) => {}
                Err(ServiceError::Stopping) => return,
                Err(error) => {
                    tracing::error!(error = %error, "Scenarios could not be prepared; trying again soon.");
                    tokio::time::sleep(PAUSE).await;
                }
            }
        }
    }

    /// Begins what may be begun, waits until something is done or comes in, and stores what is done while more is begun.
    async fn turn(&self, begun: &mut Begun) -> Result<(), ServiceError> {
        self.begin(begun).await?;
        let first = tokio::select! {
            done = begun.jobs.join_next(), if !begun.jobs.is_empty() => done,
            () = self.wake.notified() => None,
            () = tokio::time::sleep(PAUSE) => None,
        };
        let mut change = StorePrepared { prepared: Vec::new(), hopeless: Vec::new() };
        let others = std::iter::from_fn(|| begun.jobs.try_join_next());
        let done: Vec<_> = first.into_iter().chain(others).collect();
        for done in done {
            match done {
                Ok(Some((run, seq, Some(prepared)))) => change.prepared.push((run, seq, prepared)),
                Ok(Some((run, seq, None))) => change.hopeless.push((run, seq)),
                // The job is gone, and with it which it was: all may be begun again. What is prepared twice is stored once.
                Ok(None) | Err(_) => begun.of.clear(),
            }
        }
        let prepared = change.prepared.iter().map(|(run, seq, _)| (run.clone(), *seq));
        let done: Vec<_> = prepared.chain(change.hopeless.iter().cloned()).collect();
        if done.is_empty() {
            return Ok(());
        }
        // Whatever becomes of the others, what is done is stored.
        let more = self.begin(begun).await;
        let stored = self.writer.change(change).await;
        // What could not be stored is begun again.
        done.iter().for_each(|(run, seq)| begun.forget(run, *seq));
        stored?;
        self.ready.send_modify(|n| *n += 1);
        more
    }

    async fn begin(&self, begun: &mut Begun) -> Result<(), ServiceError> {
        if begun.jobs.len() >= AT_ONCE {
            return Ok(());
        }
        let mut conn = self.readers.acquire().await?;
        let waiting = unprepared(&mut conn, LOOK).await?;
        let most = begun.share(&waiting);
        for waiting in waiting {
            if begun.takes(&waiting, most) {
                begun.of.entry(waiting.run.clone()).or_default().insert(waiting.seq);
                let read = read(&mut conn, &waiting).await.inspect_err(|error| {
                    let (run, seq) = (&waiting.run, waiting.seq);
                    tracing::warn!(run, seq, error = %error, "A proposal cannot be read and is dropped.");
                });
                let Ok((proposal, origin)) = read else {
                    begun.jobs.spawn(async move { Some((waiting.run, waiting.seq, None)) });
                    continue;
                };
                let (told, done) = oneshot::channel();
                let hopeless = Arc::clone(&self.hopeless);
                self.pool.spawn(move || {
                    // Where the service stops nobody listens any more, and nothing more is looked for.
                    let waits = || !told.is_closed();
                    let done = one(&waiting, &proposal, origin.as_ref(), (&hopeless, &waits));
                    let _ = told.send(done);
                });
                begun.jobs.spawn(async { done.await.ok() });
            }
        }
        Ok(())
    }
}

/// A proposal that waits, and what it goes on from.
async fn read(
    conn: &mut SqliteConnection,
    waiting: &UnpreparedProposal,
) -> Result<(Proposal, Option<Origin>), ServiceError> {
    let proposal: Proposal = from_json("a proposal", &waiting.body)?;
    let origin = match proposal.source.parent_proposal() {
        Some(of) => origin(conn, &waiting.run, of, &proposal).await?,
        None => None,
    };
    Ok((proposal, origin))
}

/// What an earlier proposal of the run left; none where it is not kept any more.
async fn origin(
    conn: &mut SqliteConnection,
    run: &str,
    of: u64,
    proposal: &Proposal,
) -> Result<Option<Origin>, ServiceError> {
    let Some(stored) = proposals::scenario_of(conn, run, to_i64(of)).await? else { return Ok(None) };
    let row = runs::get(conn, run).await?.ok_or_else(|| ServiceError::UnknownRun(run.to_owned()))?;
    let settings: RunSettings = from_json("a run's settings", &row.settings)?;
    let sets = ScenarioCache::of(conn, &[&stored.id]).await?;
    let (scenario, bracket) = sets.get(&stored.id, false)?;
    let levels = settings.curriculum.task(&proposal.task).map(|plan| plan.levels.clone());
    Ok(bracket.zip(levels).map(|(bracket, levels)| Origin {
        scenario: scenario.clone(),
        bracket: bracket.clone(),
        contested: stored.is_contested,
        levels,
    }))
}

/// Prepares one proposal; none where that cannot be done. One that is broken must not hold up the others.
fn one(
    waiting: &UnpreparedProposal,
    proposal: &Proposal,
    origin: Option<&Origin>,
    (hopeless, waits): (&UnsolvableParams, Waits<'_>),
) -> Done {
    let _busy = metrics::BusyGuard::new("prepare");
    let (run, seq) = (&waiting.run, waiting.seq);
    let prepared = std::panic::catch_unwind(AssertUnwindSafe(|| {
        let (run_seed, seq) = (to_u64(waiting.run_seed), to_u64(seq));
        prepare(Place { space: SeedSpace::Training, run_seed, seq }, proposal, origin, (hopeless, waits))
    }));
    let prepared = match prepared {
        Ok(Ok(prepared)) => Some(prepared),
        Ok(Err(PrepareError::NotWanted)) => None,
        Ok(Err(error)) => {
            tracing::warn!(run, seq, error = %error, "A proposal cannot be prepared and is dropped.");
            None
        }
        Err(_) => {
            tracing::error!(run, seq, "Preparing a proposal panicked; it is dropped.");
            None
        }
    };
    (run.clone(), seq, prepared)
}
