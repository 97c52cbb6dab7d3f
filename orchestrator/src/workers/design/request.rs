//! Runs one design request from its start to its stored result.

use std::sync::Arc;
use std::time::{Duration, Instant};

use designer::Gate;
use designer::design_thread::{DesignResult, DesignTask, run_designer};
use job_queue::Receipt;
use job_queue::nats::server::{DesignQueue, RemoteDesign};
use jobs::design::{DesignJob, JobDesigner};
use tokio::sync::{Semaphore, watch};

use super::DesignWorker;
use crate::designs::DesignerKind;
use crate::designs::brief::{self, BriefWithArchive};
use crate::designs::finish_design::{FinishDesignRequest, MadeLayout};
use crate::designs::place::Place;
use crate::designs::start_design::StartedDesignRequest;
use crate::engine::error::ServiceError;
use crate::metrics;
use crate::threads::ThreadPriority;

/// Maximum number of tries to store the result of a request.
const MAX_STORE_TRIES: u32 = 30;
/// Pause between two tries to store a result.
const STORE_RETRY_PAUSE: Duration = Duration::from_secs(2);

/// Maximum number of workers that are asked for a design that the server cannot make itself.
const MAX_REMOTE_ATTEMPTS: usize = 3;
/// Pause between two of these workers.
const REMOTE_RETRY_PAUSE: Duration = Duration::from_secs(1);

/// Shared state of all requests.
#[derive(Clone)]
pub(super) struct DesignContext {
    pub(super) worker: DesignWorker,
    /// Limits the procedural designer, which computes, to one request of this server.
    pub(super) procedural: Arc<Semaphore>,
    /// Limits concurrent requests of this server to language models.
    pub(super) llm: Arc<Semaphore>,
    /// Closes when the service stops.
    pub(super) stopping: watch::Receiver<()>,
}

impl DesignContext {
    /// Runs a request and stores its result.
    pub(super) async fn run_request(self, request: StartedDesignRequest) {
        let _busy = metrics::BusyGuard::new("design");
        let started_at = Instant::now();
        let (id, run) = (request.id, request.run.clone());
        let empty = FinishDesignRequest::empty(id, run.clone(), request.task.clone());
        let mut finish = FinishDesignRequest { place: request.place, ..empty };
        let mut receipt = Receipt::default();
        finish.error = self.make_layouts(&request, &mut finish, &mut receipt).await.err();
        finish.elapsed = started_at.elapsed();
        match &finish.error {
            Some(error) => {
                tracing::warn!(run, request = id, error, "A design request failed; the run continues.");
            }
            None => tracing::debug!(run, request = id, "A design request finished."),
        }
        for _ in 0..MAX_STORE_TRIES {
            match self.worker.writer.change(finish.clone()).await {
                Ok(_) => {
                    receipt.acknowledge();
                    break;
                }
                Err(ServiceError::Stopping) => break,
                Err(error) if error.is_temporary() => tokio::time::sleep(STORE_RETRY_PAUSE).await,
                Err(error) => {
                    tracing::error!(run, request = id, error = %error, "The result of a design request cannot be stored.");
                    finish.made.clear();
                    finish.error =
                        Some("the result could not be stored; the server's log has the reason".to_owned());
                    tokio::time::sleep(STORE_RETRY_PAUSE).await;
                }
            }
        }
    }

    /// Asks the requested designer, and the procedural one for the layouts that are then missing. Adds what to acknowledge after the
    /// commit to `receipt`.
    async fn make_layouts(
        &self,
        request: &StartedDesignRequest,
        finish: &mut FinishDesignRequest,
        receipt: &mut Receipt,
    ) -> Result<(), String> {
        let BriefWithArchive { mut brief, archive } = {
            let mut conn = self.worker.readers.acquire().await.map_err(|error| error.to_string())?;
            brief::load_brief(&mut conn, request).await.map_err(|error| error.to_string())?
        };
        let language = designer::design_language(request.recipe.task());
        let language = language.ok_or_else(|| format!("{} has no design language", request.task))?;
        let mut gate = Gate::new(language, archive.clone());
        if request.designer == DesignerKind::Llm {
            let task = DesignTask { brief: brief.clone(), gate };
            match self.run_designer(DesignerKind::Llm, &request.run, task).await {
                Ok(design) => gate = finish.add(design, receipt),
                Err(error) => {
                    finish.warnings.push(format!("the language model failed: {error}"));
                    gate = Gate::new(language, archive);
                }
            }
        }
        let admitted = finish.made.iter().filter(|made| made.judged.verdict.is_ok()).count();
        let missing = brief.count.saturating_sub(admitted);
        if missing == 0 {
            return Ok(());
        }
        if request.designer == DesignerKind::Llm {
            let wanted = brief.count;
            finish.warnings.push(format!(
                "the gate admitted {admitted} of {wanted} layouts of the language model; the procedural designer makes the others"
            ));
        }
        brief.count = missing;
        let task = DesignTask { brief, gate };
        finish.add(self.run_designer(DesignerKind::Procedural, &request.run, task).await?, receipt);
        Ok(())
    }

    /// Lets a worker on another machine run a designer if one has room; else runs it here, after waiting for its turn.
    async fn run_designer(
        &self,
        kind: DesignerKind,
        run: &str,
        task: DesignTask,
    ) -> Result<RemoteDesign, String> {
        let designer = self.worker.designers.designer(kind, run);
        let mut error = format!("the server has no {kind} designer");
        if let Some(remote) = &self.worker.remote {
            match self.design_remotely(remote, kind, run, &task, designer.is_some()).await {
                Some(Ok(design)) => return Ok(design),
                Some(Err(reason)) => error = reason,
                None => {}
            }
        }
        let designer = designer.ok_or(error)?;
        let limit = if kind == DesignerKind::Procedural { &self.procedural } else { &self.llm };
        let _permit = limit.acquire().await.map_err(|_| "the server is stopping".to_owned())?;
        let begin = || ThreadPriority::Background.apply();
        let result = run_designer(designer, task, begin, self.stopping.clone()).await?;
        Ok(RemoteDesign { result, receipt: Receipt::default() })
    }

    /// Asks a worker for a design, or several in turn if it is not possible here. `None` if no worker takes such requests now.
    async fn design_remotely(
        &self,
        remote: &DesignQueue,
        kind: DesignerKind,
        run: &str,
        task: &DesignTask,
        is_possible_here: bool,
    ) -> Option<Result<RemoteDesign, String>> {
        let designer = match kind {
            DesignerKind::Procedural => JobDesigner::Procedural,
            DesignerKind::Llm => JobDesigner::Llm,
        };
        // A request that is possible here does not wait for a worker.
        let may_wait = !is_possible_here && remote.is_served(designer.kind());
        if !may_wait && !remote.has_room(designer.kind()) {
            return None;
        }
        let (brief, archive) = (task.brief.clone(), task.gate.archive().to_vec());
        let job = Arc::new(DesignJob { run: run.to_owned(), designer, brief, archive });
        let mut attempt = 1;
        loop {
            let error = match remote.design(Arc::clone(&job)).await {
                Ok(design) => return Some(Ok(design)),
                Err(error) => error,
            };
            tracing::debug!(run, %error, "No worker made a design.");
            if is_possible_here || attempt >= MAX_REMOTE_ATTEMPTS {
                return Some(Err(error.to_string()));
            }
            attempt += 1;
            tokio::time::sleep(REMOTE_RETRY_PAUSE).await;
        }
    }
}

impl FinishDesignRequest {
    /// Returns a result without layouts.
    pub(super) fn empty(id: i64, run: String, task: String) -> Self {
        Self {
            id,
            run,
            task,
            place: Place::default(),
            made: Vec::new(),
            usage: designer::DesignUsage::default(),
            warnings: Vec::new(),
            error: None,
            elapsed: Duration::ZERO,
        }
    }

    /// Adds the result of a designer and what to acknowledge for it, and returns its gate.
    fn add(&mut self, design: RemoteDesign, receipt: &mut Receipt) -> Gate {
        let RemoteDesign { result: DesignResult { designer, outcome, gate }, receipt: due } = design;
        receipt.merge(due);
        self.made.extend(outcome.judged.into_iter().map(|judged| MadeLayout { designer, judged }));
        self.warnings.extend(outcome.warnings);
        let used = outcome.usage;
        self.usage.model = self.usage.model.take().or(used.model);
        self.usage.prompt = self.usage.prompt.take().or(used.prompt);
        self.usage.rounds = self.usage.rounds.saturating_add(used.rounds);
        self.usage.tokens_in = self.usage.tokens_in.saturating_add(used.tokens_in);
        self.usage.tokens_out = self.usage.tokens_out.saturating_add(used.tokens_out);
        self.usage.cost += used.cost;
        gate
    }
}
