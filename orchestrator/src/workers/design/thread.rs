//! Runs a designer on a thread of its own: it may take long, compute much, or panic.

use std::panic::AssertUnwindSafe;
use std::time::Duration;

use designer::{DesignBrief, DesignOutcome, Designer, Gate};
use tokio::runtime::Handle;
use tokio::sync::{oneshot, watch};

use crate::threads::ThreadPriority;

/// Maximum time of a designer for one request.
const DESIGN_TIMEOUT: Duration = Duration::from_secs(600);

/// Inputs of a designer.
pub(super) struct DesignTask {
    pub(super) brief: DesignBrief,
    pub(super) gate: Gate,
}

/// Result of a designer.
pub(super) struct DesignResult {
    /// Name of the designer.
    pub(super) designer: &'static str,
    pub(super) outcome: DesignOutcome,
    /// The gate, which knows the layouts that it admitted.
    pub(super) gate: Gate,
}

/// Runs a designer to its end, or until `stopping` closes.
///
/// # Errors
/// Returns a message if the designer fails, panics, takes too long or is stopped.
pub(super) async fn run_designer(
    designer: Box<dyn Designer>,
    task: DesignTask,
    stopping: watch::Receiver<()>,
) -> Result<DesignResult, String> {
    let (sender, receiver) = oneshot::channel();
    let handle = Handle::current();
    let thread = std::thread::Builder::new().name("design".to_owned());
    let spawned = thread.spawn(move || {
        ThreadPriority::Background.apply();
        let work = AssertUnwindSafe(|| handle.block_on(design(designer, task, stopping)));
        let result = std::panic::catch_unwind(work).unwrap_or_else(|panic| Err(panic_message(&*panic)));
        // The receiver is gone if the service stops.
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
        // Nothing is ever sent: the channel closes when the worker ends.
        _ = stopping.changed() => return Err("the server is stopping".to_owned()),
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
