//! Runs one design request from its start to its stored result.

use std::sync::Arc;
use std::time::{Duration, Instant};

use designer::Gate;
use tokio::sync::{Semaphore, watch};

use super::DesignWorker;
use super::thread::{DesignResult, DesignTask, run_designer};
use crate::designs::DesignerKind;
use crate::designs::brief::{self, BriefWithArchive};
use crate::designs::finish_design::{FinishDesignRequest, MadeLayout};
use crate::designs::place::Place;
use crate::designs::start_design::StartedDesignRequest;
use crate::engine::error::ServiceError;
use crate::metrics;

/// Maximum number of tries to store the result of a request.
const MAX_STORE_TRIES: u32 = 30;
/// Pause between two tries to store a result.
const STORE_RETRY_PAUSE: Duration = Duration::from_secs(2);

/// Shared state of all requests.
#[derive(Clone)]
pub(super) struct DesignContext {
    pub(super) worker: DesignWorker,
    /// Limits the procedural designer, which computes, to one request.
    pub(super) procedural: Arc<Semaphore>,
    /// Limits concurrent requests to language models.
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
        finish.error = self.make_layouts(&request, &mut finish).await.err();
        finish.elapsed = started_at.elapsed();
        match &finish.error {
            Some(error) => {
                tracing::warn!(run, request = id, error, "A design request failed; the run continues.");
            }
            None => tracing::debug!(run, request = id, "A design request finished."),
        }
        for _ in 0..MAX_STORE_TRIES {
            match self.worker.writer.change(finish.clone()).await {
                Ok(_) | Err(ServiceError::Stopping) => break,
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

    /// Asks the requested designer, and the procedural one for the layouts that are then missing.
    async fn make_layouts(
        &self,
        request: &StartedDesignRequest,
        finish: &mut FinishDesignRequest,
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
                Ok(result) => gate = finish.add(result),
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
        finish.add(self.run_designer(DesignerKind::Procedural, &request.run, task).await?);
        Ok(())
    }

    /// Runs a designer, after waiting for its turn.
    async fn run_designer(
        &self,
        kind: DesignerKind,
        run: &str,
        task: DesignTask,
    ) -> Result<DesignResult, String> {
        let designer = self.worker.designers.designer(kind, run);
        let designer = designer.ok_or_else(|| format!("the server has no {kind} designer"))?;
        let limit = if kind == DesignerKind::Procedural { &self.procedural } else { &self.llm };
        let _permit = limit.acquire().await.map_err(|_| "the server is stopping".to_owned())?;
        run_designer(designer, task, self.stopping.clone()).await
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

    /// Adds the result of a designer, and returns its gate.
    fn add(&mut self, DesignResult { designer, outcome, gate }: DesignResult) -> Gate {
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
