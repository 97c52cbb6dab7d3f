//! Runs design requests at background priority: those of users, and those that are due because the reserve runs low or the failure
//! profile has changed. A worker on another machine designs if one has room, else this server. If a designer fails, its run continues.

mod request;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::time::{Duration, Instant};

use job_queue::nats::server::DesignQueue;
use jobs::JobKind;
use sqlx::SqlitePool;
use store::design_counters;
use store::design_queue::{self, DesignRequestRef};
use tokio::sync::{Notify, Semaphore, watch};
use tokio::task::{Id, JoinError, JoinSet};

use self::request::DesignContext;
use crate::designs::finish_design::FinishDesignRequest;
use crate::designs::start_design::StartDesignRequest;
use crate::designs::{Designers, demand};
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::workers::round_error::ends_worker;

/// Interval between two checks whether a request is due.
const POLL_INTERVAL: Duration = Duration::from_secs(1);
/// Interval between two checks of a run in which no more episodes were criticised.
const RECHECK_INTERVAL: Duration = Duration::from_secs(20);
/// Pause after an error of the worker itself.
const ERROR_PAUSE: Duration = Duration::from_secs(2);
/// Maximum number of concurrent requests to language models.
const MAX_LLM_REQUESTS: usize = 4;
/// Pause of a run whose request could not be started.
const FAILED_RUN_PAUSE: Duration = Duration::from_secs(60);

/// Worker that runs design requests.
#[derive(Debug, Clone)]
pub(super) struct DesignWorker {
    /// Pool of connections that read.
    pub readers: SqlitePool,
    /// Handle to the one writer.
    pub writer: Writer,
    /// Signal that a request waits or may be due.
    pub wake: Arc<Notify>,
    /// Source of designers for runs.
    pub designers: Arc<dyn Designers>,
    /// Designs by workers on other machines, if they are configured.
    pub remote: Option<DesignQueue>,
}

/// Requests that are running, and runs that are not checked for now.
#[derive(Default)]
struct ActiveRequests {
    jobs: JoinSet<()>,
    /// Run of each job.
    by_job: HashMap<Id, String>,
    /// Runs with a running request.
    runs: BTreeSet<String>,
    /// Last check of each run in which nothing was due.
    checks: BTreeMap<String, DueCheck>,
    /// Runs whose request could not be started, and when.
    failed: BTreeMap<String, Instant>,
}

/// A check whether a request is due.
struct DueCheck {
    /// Number of criticised episodes at the time.
    criticised: i64,
    at: Instant,
}

impl DesignWorker {
    /// Runs until the writer stops.
    pub(super) async fn run(self) {
        // The sender is dropped when this future ends, however it ends: running designers stop with it.
        let (_alive, stopping) = watch::channel(());
        let context = DesignContext {
            worker: self.clone(),
            procedural: Arc::new(Semaphore::new(1)),
            llm: Arc::new(Semaphore::new(MAX_LLM_REQUESTS)),
            stopping,
        };
        let mut active = ActiveRequests::default();
        loop {
            match self.start_requests(&context, &mut active).await {
                Ok(()) => {}
                Err(error) if ends_worker(&error, "design requests could not be started") => return,
                Err(_) => tokio::time::sleep(ERROR_PAUSE).await,
            }
            tokio::select! {
                Some(ended) = active.jobs.join_next_with_id() => active.remove(ended),
                () = self.wake.notified() => {}
                () = tokio::time::sleep(POLL_INTERVAL) => {}
            }
        }
    }

    /// True if this server or a connected worker has a language model for designs.
    fn has_llm(&self) -> bool {
        let is_served = |remote: &DesignQueue| remote.is_served(JobKind::DesignLlm);
        self.designers.has_llm() || self.remote.as_ref().is_some_and(is_served)
    }

    /// Starts the requests that wait, and those that are due.
    async fn start_requests(
        &self,
        context: &DesignContext,
        active: &mut ActiveRequests,
    ) -> Result<(), ServiceError> {
        let (running, waiting, criticised) = {
            let mut conn = self.readers.acquire().await?;
            let running = design_queue::all_running(&mut conn).await?;
            let waiting = design_queue::oldest_waiting(&mut conn).await?;
            (running, waiting, design_counters::criticised(&mut conn, demand::MIN_CRITICISED).await?)
        };
        // A request whose result could not be stored must not block its run for ever.
        for request in running.into_iter().filter(|request| !active.runs.contains(&request.run)) {
            let DesignRequestRef { id, run, task } = request;
            let error = Some("the result was lost; the server's log has the reason".to_owned());
            let lost = FinishDesignRequest { error, ..FinishDesignRequest::empty(id, run, task) };
            self.writer.change(lost).await?;
        }
        for request in waiting {
            self.start(context, active, request.run, Some(request.id)).await?;
        }
        let mut criticised_by_run: BTreeMap<String, i64> = BTreeMap::new();
        for counts in criticised {
            *criticised_by_run.entry(counts.run).or_default() += counts.criticised;
        }
        for (run, criticised) in criticised_by_run {
            if active.needs_check(&run, criticised) {
                self.start(context, active, run, None).await?;
            }
        }
        Ok(())
    }

    /// Starts a request of a run: the waiting one, or one that is due. A run that fails does not delay the others.
    async fn start(
        &self,
        context: &DesignContext,
        active: &mut ActiveRequests,
        run: String,
        waiting: Option<i64>,
    ) -> Result<(), ServiceError> {
        let is_paused = active.failed.get(&run).is_some_and(|at| at.elapsed() < FAILED_RUN_PAUSE);
        if is_paused || active.runs.contains(&run) {
            return Ok(());
        }
        let change = StartDesignRequest { run: run.clone(), waiting, has_llm: self.has_llm() };
        let started = match self.writer.change(change).await {
            Ok(started) => started,
            Err(error @ (ServiceError::Stopping | ServiceError::Busy)) => return Err(error),
            Err(ServiceError::UnknownRun(_)) => None, // it was deleted meanwhile
            Err(error) => {
                tracing::error!(run, error = %error, "A design request could not be started; the server retries.");
                active.failed.insert(run.clone(), Instant::now());
                None
            }
        };
        if let Some(started) = started {
            let job = active.jobs.spawn(context.clone().run_request(started));
            active.by_job.insert(job.id(), run.clone());
            active.runs.insert(run);
        }
        Ok(())
    }
}

impl ActiveRequests {
    /// Returns true if a run is to be checked: more episodes were criticised, or 20 s have passed since nothing was due.
    fn needs_check(&mut self, run: &str, criticised: i64) -> bool {
        let is_recent =
            |check: &DueCheck| check.criticised == criticised && check.at.elapsed() < RECHECK_INTERVAL;
        if self.runs.contains(run) || self.checks.get(run).is_some_and(is_recent) {
            return false;
        }
        self.checks.insert(run.to_owned(), DueCheck { criticised, at: Instant::now() });
        true
    }

    /// Removes a request that ended.
    fn remove(&mut self, ended: Result<(Id, ()), JoinError>) {
        let id = match ended {
            Ok((id, ())) => id,
            Err(error) => {
                tracing::error!(error = %error, "A design request panicked.");
                error.id()
            }
        };
        if let Some(run) = self.by_job.remove(&id) {
            self.runs.remove(&run);
            self.checks.remove(&run);
        }
    }
}
