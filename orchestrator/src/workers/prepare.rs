//! Prepares the scenarios of waiting proposals, in order and in parallel.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use job_queue::{CompletedJob, JobQueue, Receipt};
use jobs::prepare::ParentScenario;
use jobs::prepare::job::{PendingProposal, PrepareOutcome, PreparePayload};
use jobs::{JobOutput, JobPayload};
use sqlx::{SqliteConnection, SqlitePool};
use store::proposals::{self, ProposalKey, UnpreparedProposal};
use store::{from_json, runs, to_i64, to_u64};
use tokio::sync::{Notify, watch};
use tokio::task::JoinSet;

use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::leases::scenario_cache::ScenarioCache;
use crate::leases::store_prepared::{ScenarioOfProposal, StorePrepared};
use crate::metrics;
use crate::runs::settings::RunSettings;
use crate::workers::round_error::ends_worker;
use curriculum::Proposal;

/// Maximum number of jobs that run concurrently, of all runs together. It exceeds the number of cores: a scenario that takes seconds
/// must not delay those that take milliseconds, and the operating system shares the cores among them.
pub const MAX_JOBS: usize = 16;
/// Maximum number of proposals of a job. Most scenarios take far less time than to store one, so several are stored together.
const MAX_PROPOSALS_OF_JOB: usize = 8;
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
    /// Queue that prepares, up to [`MAX_JOBS`] jobs at once.
    pub queue: Arc<dyn JobQueue>,
}

/// A job that has ended.
struct EndedJob {
    /// Proposals of the job, with their results.
    results: Vec<(ProposalKey, PrepareOutcome)>,
    /// What to acknowledge after the commit.
    receipt: Receipt,
}

/// Proposals that are being prepared.
#[derive(Default)]
struct ActiveJobs {
    /// A job without results was lost: its thread panicked, or the pool is gone.
    jobs: JoinSet<Option<EndedJob>>,
    by_run: BTreeMap<String, ActiveJobsOfRun>,
}

/// Proposals of a run that are being prepared.
#[derive(Default)]
struct ActiveJobsOfRun {
    /// Number of jobs whose results are not stored.
    jobs: usize,
    /// Sequence numbers of their proposals.
    seqs: BTreeSet<i64>,
}

impl ActiveJobs {
    /// Returns the proposals of each new job. A run has no more than an equal share of the jobs, computed for one run more than
    /// there are: a new run then finds free jobs, however long the others take. Its proposals are shared among its jobs.
    fn plan(&self, waiting: Vec<UnpreparedProposal>) -> Vec<Vec<UnpreparedProposal>> {
        let mut by_run: BTreeMap<String, Vec<UnpreparedProposal>> = BTreeMap::new();
        for proposal in waiting {
            let active = self.by_run.get(&proposal.run);
            if active.is_none_or(|active| !active.seqs.contains(&proposal.seq)) {
                by_run.entry(proposal.run.clone()).or_default().push(proposal);
            }
        }
        let runs: BTreeSet<&String> = self.by_run.keys().chain(by_run.keys()).collect();
        let share = (MAX_JOBS / (runs.len() + 1)).max(1);
        let mut planned = Vec::new();
        for (run, mut proposals) in by_run {
            let active = self.by_run.get(&run).map_or(0, |active| active.jobs);
            let size = proposals.len().div_ceil(share).clamp(1, MAX_PROPOSALS_OF_JOB);
            for _ in active..share {
                if proposals.is_empty() || self.jobs.len() + planned.len() >= MAX_JOBS {
                    break;
                }
                let rest = proposals.split_off(size.min(proposals.len()));
                planned.push(std::mem::replace(&mut proposals, rest));
            }
        }
        planned
    }

    /// Adds the proposals of a job.
    fn insert(&mut self, job: &[UnpreparedProposal]) {
        let Some(first) = job.first() else { return };
        let active = self.by_run.entry(first.run.clone()).or_default();
        active.jobs += 1;
        active.seqs.extend(job.iter().map(|proposal| proposal.seq));
    }

    /// Removes the proposals of a job.
    fn remove(&mut self, job: &[ProposalKey]) {
        let Some(first) = job.first() else { return };
        if let Some(active) = self.by_run.get_mut(&first.run) {
            active.jobs = active.jobs.saturating_sub(1);
            job.iter().for_each(|proposal| {
                active.seqs.remove(&proposal.seq);
            });
            if active.seqs.is_empty() {
                self.by_run.remove(&first.run);
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
        let (mut change, mut receipt, mut done) = (StorePrepared::default(), Receipt::default(), Vec::new());
        for ended in ended {
            let Ok(Some(ended)) = ended else {
                // The proposals of a lost job are unknown, so all may start again. A scenario that is prepared twice is stored once.
                active.by_run.clear();
                continue;
            };
            receipt.merge(ended.receipt);
            done.push(ended.results.iter().map(|(proposal, _)| proposal.clone()).collect::<Vec<_>>());
            ended
                .results
                .into_iter()
                .for_each(|(proposal, outcome)| add_outcome(&mut change, proposal, outcome));
        }
        if done.is_empty() {
            return Ok(());
        }
        // The results are stored even if no more jobs can start.
        let started = self.start_jobs(active).await;
        let stored = self.writer.change(change).await;
        // A result that could not be stored is prepared again.
        done.iter().for_each(|job| active.remove(job));
        stored?;
        receipt.acknowledge();
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
        for planned in active.plan(waiting) {
            active.insert(&planned);
            let mut job = PrepareJob::default();
            for waiting in planned {
                job.load(&mut conn, waiting).await;
            }
            active.jobs.spawn(job.run(Arc::clone(&self.queue)));
        }
        Ok(())
    }
}

/// Adds the result of a proposal to a change.
fn add_outcome(change: &mut StorePrepared, proposal: ProposalKey, outcome: PrepareOutcome) {
    match outcome {
        PrepareOutcome::Scenario(scenario) => {
            change.prepared.push(ScenarioOfProposal { proposal, scenario: *scenario });
        }
        PrepareOutcome::Failed(reason) => {
            if let Some(reason) = reason {
                let ProposalKey { run, seq } = &proposal;
                tracing::warn!(run, seq, reason, "A proposal cannot be prepared and is dropped.");
            }
            change.failed.push(proposal);
        }
        PrepareOutcome::Untried => {}
    }
}

/// Proposals of a run, in order.
#[derive(Default)]
struct PrepareJob {
    loaded: Vec<ProposalKey>,
    payload: PreparePayload,
    /// Proposals that cannot be read.
    failed: Vec<ProposalKey>,
}

impl PrepareJob {
    /// Loads a proposal and adds it.
    async fn load(&mut self, conn: &mut SqliteConnection, waiting: UnpreparedProposal) {
        let loaded = load_proposal(conn, &waiting).await;
        let UnpreparedProposal { run, seq, .. } = waiting;
        match loaded {
            Ok(pending) => {
                self.loaded.push(ProposalKey { run, seq });
                self.payload.0.push(pending);
            }
            Err(error) => {
                tracing::warn!(run, seq, error = %error, "A proposal cannot be read and is dropped.");
                self.failed.push(ProposalKey { run, seq });
            }
        }
    }

    /// Prepares the proposals; `None` if the job is lost.
    async fn run(self, queue: Arc<dyn JobQueue>) -> Option<EndedJob> {
        let _busy = metrics::BusyGuard::new("prepare");
        let Self { loaded, payload, failed } = self;
        let failed = failed.into_iter().map(|proposal| (proposal, PrepareOutcome::Failed(None)));
        if loaded.is_empty() {
            return Some(EndedJob { results: failed.collect(), receipt: Receipt::default() });
        }
        let done = queue.run(JobPayload::Prepare(payload)).await.ok()?;
        let CompletedJob { output: JobOutput::Prepare(output), receipt } = done else { return None };
        Some(EndedJob { results: failed.chain(loaded.into_iter().zip(output.0)).collect(), receipt })
    }
}

/// Loads a proposal with everything that its preparation needs.
async fn load_proposal(
    conn: &mut SqliteConnection,
    waiting: &UnpreparedProposal,
) -> Result<PendingProposal, ServiceError> {
    let proposal: Proposal = from_json("a proposal", &waiting.body)?;
    let parent = match proposal.source.parent_proposal() {
        Some(seq) => load_parent(conn, &waiting.run, seq, &proposal).await?,
        None => None,
    };
    Ok(PendingProposal { run_seed: to_u64(waiting.run_seed), seq: to_u64(waiting.seq), proposal, parent })
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
