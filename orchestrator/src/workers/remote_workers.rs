//! Announces the workers on other machines: in the log, and as warnings of the active runs. Corrects wrong results of expelled ones.

use std::time::Duration;

use job_queue::status::{QueueNotice, Recomputation, WorkerIdentity, WrongLayout, WrongResult};
use jobs::audit::{AuditOutput, AuditPayload};
use jobs::{JobOutput, JobPayload};
use sqlx::SqlitePool;
use store::runs;
use tokio::sync::mpsc::UnboundedReceiver;

use crate::designs::retire_wrong::{RetireWrongLayouts, RetiredLayouts};
use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::engine::writer::Writer;
use crate::results::correct_results::{CorrectResults, ServerReplay};
use crate::workers::round_error::ends_worker;

/// Largest number of tries to retire layouts. Together they take longer than a language model has for a design request.
const MAX_RETIREMENTS: u32 = 600;
/// Pause between two of these tries.
const RETIREMENT_PAUSE: Duration = Duration::from_secs(2);

/// Runs until the queue ends.
pub(super) async fn run(readers: SqlitePool, writer: Writer, mut notices: UnboundedReceiver<QueueNotice>) {
    while let Some(notice) = notices.recv().await {
        let message = describe(&notice);
        let severity = Severity::of(&notice);
        severity.log(&message);
        let announced = announce(&readers, &writer, WorkerMessage { severity, message }).await;
        let handled = match notice {
            QueueNotice::Recomputed(Recomputation { wrong, wrong_layouts, .. }) => {
                tokio::spawn(retire_layouts(writer.clone(), wrong_layouts));
                correct(&writer, wrong).await.and(announced)
            }
            _ => announced,
        };
        match handled {
            Ok(()) => {}
            Err(error) if ends_worker(&error, "a worker could not be announced") => return,
            Err(_) => {} // the log has it
        }
    }
}

/// How serious a notice is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Severity {
    /// Operators need not do anything.
    Info,
    /// Operators should look at it.
    Warning,
    /// Stored values were or may be wrong.
    Error,
}

impl Severity {
    fn of(notice: &QueueNotice) -> Self {
        match notice {
            QueueNotice::Recomputed(Recomputation { wrong, wrong_layouts, .. })
                if !wrong.is_empty() || !wrong_layouts.is_empty() =>
            {
                Self::Error
            }
            QueueNotice::Expelled(..) => Self::Error,
            QueueNotice::Stalled(_) | QueueNotice::Refused(..) | QueueNotice::Degraded(_) => Self::Warning,
            QueueNotice::Joined(_)
            | QueueNotice::Left(_)
            | QueueNotice::Recomputed(_)
            | QueueNotice::Restored => Self::Info,
        }
    }

    fn log(self, message: &str) {
        match self {
            Self::Error => tracing::error!("{message}"),
            Self::Warning => tracing::warn!("{message}"),
            Self::Info => tracing::info!("{message}"),
        }
    }
}

/// Describes a notice in one or two sentences.
fn describe(notice: &QueueNotice) -> String {
    let name = |WorkerIdentity { id, host }: &WorkerIdentity| format!("Worker {id} on {host}");
    match notice {
        QueueNotice::Joined(worker) => format!("{} joined.", name(worker)),
        QueueNotice::Stalled(worker) => {
            format!("{} sends no heartbeats; its jobs go to other workers.", name(worker))
        }
        QueueNotice::Left(worker) => format!("{} left.", name(worker)),
        QueueNotice::Refused(worker, reason) => format!("{} was refused: {reason}.", name(worker)),
        QueueNotice::Expelled(worker, reason) => format!(
            "{} was expelled with its host: {reason}. The server recomputes its results since the last that was verified.",
            name(worker)
        ),
        QueueNotice::Recomputed(Recomputation { worker, items, wrong, wrong_layouts }) => {
            let wrong = wrong.len() + wrong_layouts.len();
            format!("{}: the server recomputed {items} results, of which {wrong} were wrong.", name(worker))
        }
        QueueNotice::Degraded(reason) => format!("Workers do no jobs: {reason}."),
        QueueNotice::Restored => "Workers do jobs again.".to_owned(),
    }
}

/// Corrects the episodes of wrong replays. Wrong scenarios and critiques stay: only their number is known to the operator.
async fn correct(writer: &Writer, wrong: Vec<WrongResult>) -> Result<(), ServiceError> {
    let replays: Vec<ServerReplay> = wrong.into_iter().filter_map(server_replay).collect();
    if replays.is_empty() {
        return Ok(());
    }
    let corrected = writer.change(CorrectResults(replays)).await?;
    tracing::warn!(corrected, "Stored results of an expelled worker were corrected.");
    Ok(())
}

/// Retires wrong layouts. Those that a design request has not stored yet are retired as soon as it has.
async fn retire_layouts(writer: Writer, mut wrong: Vec<WrongLayout>) {
    let mut tries = 0;
    while !wrong.is_empty() && tries < MAX_RETIREMENTS {
        tries += 1;
        match writer.change(RetireWrongLayouts(wrong.clone())).await {
            Ok(RetiredLayouts { retired, expected }) => {
                if retired > 0 {
                    tracing::warn!(retired, "Layouts of an expelled worker were retired.");
                }
                wrong = expected;
            }
            Err(error) if ends_worker(&error, "layouts of an expelled worker could not be retired") => return,
            Err(_) => {} // the log has it
        }
        tokio::time::sleep(RETIREMENT_PAUSE).await;
    }
}

/// The replay of the server, if a wrong result is one of an episode that replays.
fn server_replay(WrongResult { job, computed }: WrongResult) -> Option<ServerReplay> {
    let JobPayload::Audit(AuditPayload::Replays(mut batch)) = job else { return None };
    let JobOutput::Audit(AuditOutput::Replays(mut outcomes)) = computed else { return None };
    let (episode, outcome) = (batch.0.pop()?, outcomes.pop()?.ok()?);
    Some(ServerReplay { scenario: episode.scenario, log: (*episode.log).clone(), outcome })
}

/// Stores a message as a warning of every active run.
async fn announce(readers: &SqlitePool, writer: &Writer, message: WorkerMessage) -> Result<(), ServiceError> {
    let names = runs::names(&mut *readers.acquire().await?).await?;
    let runs: Vec<String> = names.into_iter().filter(|run| !run.is_archived).map(|run| run.id).collect();
    if runs.is_empty() {
        return Ok(());
    }
    writer.change(AnnounceWorker { runs, message }).await
}

/// Text about workers for operators.
struct WorkerMessage {
    severity: Severity,
    message: String,
}

/// Stores an event about workers in runs.
struct AnnounceWorker {
    runs: Vec<String>,
    message: WorkerMessage,
}

impl Change for AnnounceWorker {
    type Output = ();
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let WorkerMessage { severity, message } = &self.message;
        let event = match severity {
            Severity::Info => RunEvent::Worker { message },
            Severity::Warning | Severity::Error => RunEvent::Warning { task: None, message },
        };
        for run in &self.runs {
            // It may have been deleted meanwhile.
            if runs::exists(&mut tx.conn, run).await? {
                tx.emit(run, &event)?;
            }
        }
        Ok(())
    }
}
