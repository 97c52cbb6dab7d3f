//! Prepares the scenarios of waiting proposals, in order and in parallel.

use std::collections::{BTreeMap, BTreeSet};
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::Duration;

use env_core::SeedSpace;
use sqlx::{SqliteConnection, SqlitePool};
use store::proposals::{self, ProposalKey, UnpreparedProposal};
use store::{from_json, runs, to_i64, to_u64};
use tokio::sync::{Notify, oneshot, watch};
use tokio::task::JoinSet;

use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::leases::prepare::store_prepared::{ScenarioOfProposal, StorePrepared};
use crate::leases::prepare::unsolvable::UnsolvableParams;
use crate::leases::prepare::{
    DrawContext, ParentScenario, PrepareError, PreparedScenario, SeedSource, prepare,
};
use crate::leases::scenario_cache::ScenarioCache;
use crate::metrics;
use crate::runs::settings::RunSettings;
use crate::workers::round_error::ends_worker;
use curriculum::Proposal;

/// Maximum number of proposals that are prepared concurrently, of all runs together. It exceeds the number of cores: a scenario that
/// takes seconds must not delay those that take milliseconds, and the operating system shares the cores among them.
pub(super) const MAX_JOBS: usize = 16;
/// Number of waiting proposals that are considered for a start.
const PROPOSALS_PER_QUERY: i64 = 128;
/// Pause after an error, and maximum wait for a signal, in case one was missed.
const PAUSE: Duration = Duration::from_secs(2);

/// Worker that prepares the scenarios of proposals.
#[derive(Debug, Clone)]
pub(super) struct PrepareWorker {
    /// Pool of connections that read.
    pub readers: SqlitePool,
    /// Handle to the one writer.
    pub writer: Writer,
    /// Signal that proposals wait.
    pub wake: Arc<Notify>,
    /// Incremented when scenarios were stored, for lease requests that wait.
    pub ready: watch::Sender<u64>,
    /// The [`MAX_JOBS`] threads of this worker: scenarios that are hard to find must not delay the replay of results.
    pub pool: Arc<rayon::ThreadPool>,
    /// Params under which no scenario is solvable.
    pub unsolvable: Arc<UnsolvableParams>,
}

/// Result of preparing a proposal.
struct JobResult {
    proposal: ProposalKey,
    /// The scenario; `None` if the proposal has none.
    scenario: Option<PreparedScenario>,
}

/// Proposals that are being prepared.
#[derive(Default)]
struct ActiveJobs {
    /// A job without a result was lost: its thread panicked, or the pool is gone.
    jobs: JoinSet<Option<JobResult>>,
    /// Sequence numbers of the proposals by run, until their results are stored.
    by_run: BTreeMap<String, BTreeSet<i64>>,
}

impl ActiveJobs {
    /// Returns true if a proposal may start now, where a run may have `max_of_run` active ones.
    fn may_start(&self, waiting: &UnpreparedProposal, max_of_run: usize) -> bool {
        let active = self.by_run.get(&waiting.run);
        self.jobs.len() < MAX_JOBS
            && active.is_none_or(|active| active.len() < max_of_run && !active.contains(&waiting.seq))
    }

    /// Returns the maximum number of active proposals of a run: an equal share, computed for one run more than there are. A new run
    /// then finds free jobs, however long the others take.
    fn max_of_run(&self, waiting: &[UnpreparedProposal]) -> usize {
        let runs: BTreeSet<&String> =
            self.by_run.keys().chain(waiting.iter().map(|waiting| &waiting.run)).collect();
        (MAX_JOBS / (runs.len() + 1)).max(1)
    }

    fn insert(&mut self, waiting: &UnpreparedProposal) {
        self.by_run.entry(waiting.run.clone()).or_default().insert(waiting.seq);
    }

    fn remove(&mut self, proposal: &ProposalKey) {
        if let Some(active) = self.by_run.get_mut(&proposal.run) {
            active.remove(&proposal.seq);
            if active.is_empty() {
                self.by_run.remove(&proposal.run);
            }
        }
    }
}

impl PrepareWorker {
    /// Runs until the writer stops.
    pub(super) async fn run(self) {
        let mut active = ActiveJobs::default();
        loop {
            match self.run_once(&mut active).await {
                Ok(()) => {}
                Err(error) if ends_worker(&error, "scenarios could not be prepared") => return,
                Err(_) => tokio::time::sleep(PAUSE).await,
            }
        }
    }

    /// Starts the jobs that may start, waits for a result or a signal, and stores the results while more jobs run.
    async fn run_once(&self, active: &mut ActiveJobs) -> Result<(), ServiceError> {
        self.start_jobs(active).await?;
        let first = tokio::select! {
            ended = active.jobs.join_next(), if !active.jobs.is_empty() => ended,
            () = self.wake.notified() => None,
            () = tokio::time::sleep(PAUSE) => None,
        };
        let others = std::iter::from_fn(|| active.jobs.try_join_next());
        let ended: Vec<_> = first.into_iter().chain(others).collect();
        let mut change = StorePrepared::default();
        let mut done = Vec::new();
        for result in ended {
            match result {
                Ok(Some(JobResult { proposal, scenario })) => {
                    done.push(proposal.clone());
                    match scenario {
                        Some(scenario) => change.prepared.push(ScenarioOfProposal { proposal, scenario }),
                        None => change.failed.push(proposal),
                    }
                }
                // The proposal of a lost job is unknown, so all may start again. A scenario that is prepared twice is stored once.
                Ok(None) | Err(_) => active.by_run.clear(),
            }
        }
        if done.is_empty() {
            return Ok(());
        }
        // The results are stored even if no more jobs can start.
        let started = self.start_jobs(active).await;
        let stored = self.writer.change(change).await;
        // A result that could not be stored is prepared again.
        done.iter().for_each(|proposal| active.remove(proposal));
        stored?;
        self.ready.send_modify(|count| *count += 1);
        started
    }

    /// Starts the jobs that may start.
    async fn start_jobs(&self, active: &mut ActiveJobs) -> Result<(), ServiceError> {
        if active.jobs.len() >= MAX_JOBS {
            return Ok(());
        }
        let mut conn = self.readers.acquire().await?;
        let waiting = proposals::unprepared(&mut conn, PROPOSALS_PER_QUERY).await?;
        let max_of_run = active.max_of_run(&waiting);
        for waiting in waiting {
            if !active.may_start(&waiting, max_of_run) {
                continue;
            }
            active.insert(&waiting);
            let job = PrepareJob::load(&mut conn, &waiting).await.inspect_err(|error| {
                let (run, seq) = (&waiting.run, waiting.seq);
                tracing::warn!(run, seq, error = %error, "A proposal cannot be read and is dropped.");
            });
            let Ok(job) = job else {
                let proposal = ProposalKey { run: waiting.run, seq: waiting.seq };
                active.jobs.spawn(async move { Some(JobResult { proposal, scenario: None }) });
                continue;
            };
            let (sender, receiver) = oneshot::channel();
            let unsolvable = Arc::clone(&self.unsolvable);
            self.pool.spawn(move || {
                // The receiver is gone if the service stops; then the search ends.
                let is_wanted = || !sender.is_closed();
                let result = job.run(DrawContext { unsolvable: &unsolvable, is_wanted: &is_wanted });
                let _ = sender.send(result);
            });
            active.jobs.spawn(async { receiver.await.ok() });
        }
        Ok(())
    }
}

/// A proposal with everything that its preparation needs.
struct PrepareJob {
    key: ProposalKey,
    run_seed: u64,
    proposal: Proposal,
    /// The scenario that it derives from, if it derives from one that is still stored.
    parent: Option<ParentScenario>,
}

impl PrepareJob {
    async fn load(conn: &mut SqliteConnection, waiting: &UnpreparedProposal) -> Result<Self, ServiceError> {
        let proposal: Proposal = from_json("a proposal", &waiting.body)?;
        let parent = match proposal.source.parent_proposal() {
            Some(seq) => load_parent(conn, &waiting.run, seq, &proposal).await?,
            None => None,
        };
        let key = ProposalKey { run: waiting.run.clone(), seq: waiting.seq };
        Ok(Self { key, run_seed: to_u64(waiting.run_seed), proposal, parent })
    }

    /// Prepares the proposal. A panic fails this proposal, and no other.
    fn run(self, context: DrawContext<'_>) -> JobResult {
        let _busy = metrics::BusyGuard::new("prepare");
        let Self { key: ProposalKey { run, seq }, run_seed, proposal, parent } = self;
        let seeds = SeedSource { space: SeedSpace::Training, run_seed, seq: to_u64(seq) };
        let prepared = std::panic::catch_unwind(AssertUnwindSafe(|| {
            prepare(seeds, &proposal, parent.as_ref(), context)
        }));
        let scenario = match prepared {
            Ok(Ok(scenario)) => Some(scenario),
            Ok(Err(PrepareError::Abandoned)) => None,
            Ok(Err(error)) => {
                tracing::warn!(run, seq, error = %error, "A proposal cannot be prepared and is dropped.");
                None
            }
            Err(_) => {
                tracing::error!(run, seq, "Preparing a proposal panicked; it is dropped.");
                None
            }
        };
        JobResult { proposal: ProposalKey { run, seq }, scenario }
    }
}

/// Loads the scenario of an earlier proposal of the run; `None` if it is not stored any more.
async fn load_parent(
    conn: &mut SqliteConnection,
    run: &str,
    seq: u64,
    proposal: &Proposal,
) -> Result<Option<ParentScenario>, ServiceError> {
    let Some(stored) = proposals::scenario_of(conn, run, to_i64(seq)).await? else { return Ok(None) };
    let row = runs::get(conn, run).await?.ok_or_else(|| ServiceError::UnknownRun(run.to_owned()))?;
    let settings: RunSettings = from_json("a run's settings", &row.settings)?;
    let scenarios = ScenarioCache::of(conn, &[&stored.id]).await?;
    let (scenario, bracket) = scenarios.get(&stored.id, false)?;
    let levels = settings.curriculum.task(&proposal.task).map(|plan| plan.levels.clone());
    Ok(bracket.zip(levels).map(|(bracket, levels)| ParentScenario {
        scenario: scenario.clone(),
        bracket: bracket.clone(),
        is_contested: stored.is_contested,
        levels,
    }))
}
