//! Runs a designer on a thread of its own: it may take long, compute much, or panic.

use std::panic::AssertUnwindSafe;
use std::time::Duration;

use tokio::runtime::Handle;
use tokio::sync::{oneshot, watch};

use crate::brief::DesignBrief;
use crate::designer::{DesignOutcome, Designer};
use crate::gate::Gate;

/// Maximum time of a designer for one request.
const DESIGN_TIMEOUT: Duration = Duration::from_secs(600);

/// Inputs of a designer.
pub struct DesignTask {
    /// The brief of the request.
    pub brief: DesignBrief,
    /// The gate that judges the layouts.
    pub gate: Gate,
}

/// Result of a designer.
pub struct DesignResult {
    /// Name of the designer.
    pub designer: &'static str,
    /// The layouts with their verdicts.
    pub outcome: DesignOutcome,
    /// The gate, which knows the layouts that it admitted.
    pub gate: Gate,
}

/// Runs a designer to its end, or until `stopping` closes. `begin` is called on the thread first, for example to lower its priority.
/// It needs a Tokio runtime.
///
/// # Errors
/// Returns a message if the designer fails, panics, takes longer than ten minutes or is stopped.
pub async fn run_designer(
    designer: Box<dyn Designer>,
    task: DesignTask,
    begin: impl FnOnce() + Send + 'static,
    stopping: watch::Receiver<()>,
) -> Result<DesignResult, String> {
    let (sender, receiver) = oneshot::channel();
    let handle = Handle::current();
    let thread = std::thread::Builder::new().name("design".to_owned());
    let spawned = thread.spawn(move || {
        begin();
        let work = AssertUnwindSafe(|| handle.block_on(design(designer, task, stopping)));
        let result = std::panic::catch_unwind(work).unwrap_or_else(|panic| Err(panic_message(&*panic)));
        // The receiver is gone if the process stops.
        drop(sender.send(result));
    });
    spawned.map_err(|error| format!("a thread could not be started: {error}"))?;
    receiver.await.map_err(|_| "its thread ended".to_owned())?
}

async fn design(
    mut designer: Box<dyn Designer>,
    task: DesignTask,
    mut stopping: watch::Receiver<()>,
) -> Result<DesignResult, String> {
    let DesignTask { brief, mut gate } = task;
    let name = designer.name();
    let outcome = tokio::select! {
        // Nothing is ever sent: the channel closes when the request is not wanted any more.
        _ = stopping.changed() => return Err("the program is stopping".to_owned()),
        outcome = tokio::time::timeout(DESIGN_TIMEOUT, designer.design(&brief, &mut gate)) => outcome,
    };
    let outcome = outcome.map_err(|_| format!("it took longer than {} s", DESIGN_TIMEOUT.as_secs()))?;
    outcome.map(|outcome| DesignResult { designer: name, outcome, gate }).map_err(|error| error.to_string())
}

/// Returns the message of a panic.
fn panic_message(panic: &(dyn std::any::Any + Send)) -> String {
    let message = panic.downcast_ref::<&str>().map(|message| (*message).to_owned());
    let message = message.or_else(|| panic.downcast_ref::<String>().cloned());
    message.map_or_else(|| "it panicked".to_owned(), |message| format!("it panicked: {message}"))
}
