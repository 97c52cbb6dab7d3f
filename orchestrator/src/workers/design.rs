//! Asks designers for layouts, behind everything else: by hand, where the stock runs low, and where the agent fails at
//! something else than before. Whatever a designer does, the run goes on.

mod thread;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::time::{Duration, Instant};

use designer::Gate;
use sqlx::SqlitePool;
use tokio::sync::{Notify, Semaphore, watch};
use tokio::task::{Id, JoinSet};

use self::thread::{Shift, Task};
use crate::store::design_queue::{self, DesignRequestRef};
use crate::metrics;
use crate::store::design_counters;
use crate::designs::design_request::{StartDesignRequest, StartedDesignRequest, FinishDesignRequest};
use crate::designs::{brief, demand, Designers, DesignerKind};
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;

/// How often it looks whether anything is due.
const EVERY: Duration = Duration::from_secs(1);
/// How long a run in which nothing happens is left alone.
const AGAIN: Duration = Duration::from_secs(20);
/// How long it waits after a failure.
const PAUSE: Duration = Duration::from_secs(2);
/// Language models asked at once.
const LLM_AT_ONCE: usize = 4;
/// How long a run that cannot be looked at is left alone.
const REST: Duration = Duration::from_secs(60);
/// Tries at storing what came of an ask.
const TRIES: u32 = 30;

/// What the worker needs.
#[derive(Debug, Clone)]
pub struct DesignWorker {
    /// Where profiles and earlier layouts are read.
    pub readers: SqlitePool,
    /// Where layouts are written.
    pub writer: Writer,
    /// Rung when somebody asks by hand.
    pub wake: Arc<Notify>,
    /// Who designs.
    pub designers: Arc<dyn Designers>,
}

/// What one ask needs besides.
#[derive(Clone)]
struct Room {
    studio: DesignWorker,
    /// The procedural designer computes: one at a time.
    procedural: Arc<Semaphore>,
    llm: Arc<Semaphore>,
    /// Closed when the service stops.
    stopping: watch::Receiver<()>,
}

/// What is under way.
#[derive(Default)]
struct Underway {
    jobs: JoinSet<()>,
    /// Whose each job is.
    of: HashMap<Id, String>,
    runs: BTreeSet<String>,
    /// What each run's look at whether anything is due rested on, where nothing was.
    looked: BTreeMap<String, (i64, Instant)>,
    /// Runs that could not be looked at, and when.
    broken: BTreeMap<String, Instant>,
}

impl DesignWorker {
    /// Works until the writer is gone.
    pub async fn run(self) {
        // Held until this ends, in whatever way: designers at work end with it.
        let (_alive, stopping) = watch::channel(());
        let room = Room {
            studio: self,
            procedural: Arc::new(Semaphore::new(1)),
            llm: Arc::new(Semaphore::new(LLM_AT_ONCE)),
            stopping,
        };
        let mut begun = Underway::default();
        loop {
            match room.turn(&mut begun).await {
                Ok(()) => {}
                Err(ServiceError::Stopping) => return,
                Err(ServiceError::Busy) => tokio::time::sleep(PAUSE).await,
                Err(error) => {
                    tracing::error!(error = %error, "Designers could not be asked; trying again soon.");
                    tokio::time::sleep(PAUSE).await;
                }
            }
            tokio::select! {
                Some(done) = begun.jobs.join_next_with_id() => begun.ended(done),
                () = room.studio.wake.notified() => {}
                () = tokio::time::sleep(EVERY) => {}
            }
        }
    }
}

impl Underway {
    /// Whether a run is worth a look: more was criticised, or some time has passed since nothing was due.
    fn looks(&mut self, run: &str, criticised: i64) -> bool {
        let same = |(held, at): &(i64, Instant)| *held == criticised && at.elapsed() < AGAIN;
        if self.runs.contains(run) || self.looked.get(run).is_some_and(same) {
            return false;
        }
        self.looked.insert(run.to_owned(), (criticised, Instant::now()));
        true
    }

    fn ended(&mut self, done: Result<(Id, ()), tokio::task::JoinError>) {
        let id = match done {
            Ok((id, ())) => id,
            Err(error) => {
                tracing::error!(error = %error, "Asking a designer ended badly.");
                error.id()
            }
        };
        if let Some(run) = self.of.remove(&id) {
            self.runs.remove(&run);
            self.looked.remove(&run);
        }
    }
}

impl Room {
    /// Begins what waits, and what is due.
    async fn turn(&self, begun: &mut Underway) -> Result<(), ServiceError> {
        let (running, waiting, criticised) = {
            let mut conn = self.studio.readers.acquire().await?;
            let (running, waiting) = (design_queue::all_running(&mut conn).await?, design_queue::oldest_waiting(&mut conn).await?);
            (running, waiting, design_counters::criticised(&mut conn, demand::EPISODES).await?)
        };
        // What could not be ended when it was over must not keep its run waiting for ever.
        for request in running.into_iter().filter(|request| !begun.runs.contains(&request.run)) {
            let DesignRequestRef { id: ask, run, task } = request;
            let error = Some("what was designed was lost; the log says why".to_owned());
            let lost = FinishDesignRequest { error, ..FinishDesignRequest::nothing(ask, run, task) };
            self.studio.writer.change(lost).await?;
        }
        for request in waiting {
            self.begin(begun, request.run, Some(request.id)).await?;
        }
        let mut due: BTreeMap<String, i64> = BTreeMap::new();
        for of in criticised {
            *due.entry(of.run).or_default() += of.criticised;
        }
        for (run, criticised) in due {
            if begun.looks(&run, criticised) {
                self.begin(begun, run, None).await?;
            }
        }
        Ok(())
    }

    async fn begin(&self, begun: &mut Underway, run: String, ask: Option<i64>) -> Result<(), ServiceError> {
        if begun.runs.contains(&run) || begun.broken.get(&run).is_some_and(|at| at.elapsed() < REST) {
            return Ok(());
        }
        let has_llm = self.studio.designers.has_llm();
        let change = StartDesignRequest { run: run.clone(), ask, has_llm };
        let started = match self.studio.writer.change(change).await {
            Ok(started) => started,
            Err(error @ (ServiceError::Stopping | ServiceError::Busy)) => return Err(error),
            // A run that cannot be looked at must not hold up the others.
            Err(error) => {
                tracing::error!(run, error = %error, "A run's designs could not be looked at; later again.");
                begun.broken.insert(run.clone(), Instant::now());
                None
            }
        };
        if let Some(started) = started {
            let job = begun.jobs.spawn(self.clone().ask(started));
            begun.of.insert(job.id(), run.clone());
            begun.runs.insert(run);
        }
        Ok(())
    }

    /// One ask from its beginning to its end.
    async fn ask(self, begun: StartedDesignRequest) {
        let _busy = metrics::BusyGuard::new("design");
        let began = Instant::now();
        let run = begun.run.clone();
        let mut finish = self.design(&begun).await;
        finish.took = began.elapsed();
        match &finish.error {
            Some(error) => tracing::warn!(run, ask = begun.ask, error, "A designer failed; the run goes on."),
            None => tracing::debug!(run, ask = begun.ask, "A designer was asked."),
        }
        for _ in 0..TRIES {
            match self.studio.writer.change(finish.clone()).await {
                Ok(_) | Err(ServiceError::Stopping) => break,
                Err(error) if error.is_temporary() => tokio::time::sleep(PAUSE).await,
                Err(error) => {
                    tracing::error!(run, ask = begun.ask, error = %error, "What was designed cannot be stored.");
                    finish.made.clear();
                    finish.error = Some("what was designed could not be stored; the log says why".to_owned());
                    tokio::time::sleep(PAUSE).await;
                }
            }
        }
    }

    async fn design(&self, begun: &StartedDesignRequest) -> FinishDesignRequest {
        let nothing = FinishDesignRequest::nothing(begun.ask, begun.run.clone(), begun.task.clone());
        let mut finish = FinishDesignRequest { level: begun.level, ..nothing };
        if let Err(error) = self.fill(begun, &mut finish).await {
            finish.error = Some(error);
        }
        finish
    }

    /// Asks whom the ask is for, and the procedural designer for what is missing then.
    async fn fill(&self, begun: &StartedDesignRequest, finish: &mut FinishDesignRequest) -> Result<(), String> {
        let gathered = {
            let mut conn = self.studio.readers.acquire().await.map_err(|error| error.to_string())?;
            brief::gather(&mut conn, begun).await.map_err(|error| error.to_string())?
        };
        let (mut brief, archive) = gathered;
        let language = designer::design_language(begun.base.task());
        let language = language.ok_or_else(|| format!("nobody designs for {} yet", begun.task))?;
        let mut gate = Gate::new(language, archive.clone());
        if begun.which == DesignerKind::Llm {
            let task = Task { brief: brief.clone(), gate };
            match self.one(DesignerKind::Llm, &begun.run, task).await {
                Ok((shift, held)) => {
                    finish.take(shift);
                    gate = held;
                }
                Err(error) => {
                    finish.troubles.push(format!("the language model: {error}"));
                    gate = Gate::new(language, archive);
                }
            }
        }
        let admitted = finish.made.iter().filter(|(_, judged)| judged.verdict.is_ok()).count();
        let missing = brief.count.saturating_sub(admitted);
        if missing == 0 {
            return Ok(());
        }
        if begun.which == DesignerKind::Llm {
            let words = format!(
                "{admitted} of {} were let through; the procedural designer does the rest",
                brief.count
            );
            finish.troubles.push(words);
        }
        brief.count = missing;
        let (shift, _) = self.one(DesignerKind::Procedural, &begun.run, Task { brief, gate }).await?;
        finish.take(shift);
        Ok(())
    }

    async fn one(&self, which: DesignerKind, run: &str, task: Task) -> Result<(Shift, Gate), String> {
        let designer = self.studio.designers.designer(which, run);
        let designer = designer.ok_or_else(|| format!("there is no {} designer here", which))?;
        let seats = if which == DesignerKind::Procedural { &self.procedural } else { &self.llm };
        let _seat = seats.acquire().await.map_err(|_| "the service is stopping".to_owned())?;
        thread::design(designer, task, self.stopping.clone()).await
    }
}

impl FinishDesignRequest {
    /// An ask of which nothing came.
    fn nothing(ask: i64, run: String, task: String) -> Self {
        Self {
            ask,
            run,
            task,
            level: None,
            made: Vec::new(),
            usage: designer::DesignUsage::default(),
            troubles: Vec::new(),
            error: None,
            took: Duration::ZERO,
        }
    }

    /// Adds what a designer came up with.
    fn take(&mut self, shift: Shift) {
        let Shift { name, designed } = shift;
        self.made.extend(designed.judged.into_iter().map(|judged| (name, judged)));
        self.troubles.extend(designed.warnings);
        let used = designed.usage;
        self.usage.model = self.usage.model.take().or(used.model);
        self.usage.prompt = self.usage.prompt.take().or(used.prompt);
        self.usage.rounds = self.usage.rounds.saturating_add(used.rounds);
        self.usage.tokens_in = self.usage.tokens_in.saturating_add(used.tokens_in);
        self.usage.tokens_out = self.usage.tokens_out.saturating_add(used.tokens_out);
        self.usage.cost += used.cost;
    }
}
