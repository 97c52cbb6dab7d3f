//! A designer at work, on a thread of its own: it may take long, compute much, or panic.

use std::panic::AssertUnwindSafe;
use std::time::Duration;

use designer::{DesignBrief, DesignOutcome, Designer, Gate};
use tokio::runtime::Handle;
use tokio::sync::{oneshot, watch};

use crate::threads::ThreadPriority;

/// Longest time a designer may take over one ask.
const LIMIT: Duration = Duration::from_secs(600);

/// What a designer is given.
pub(super) struct Task {
    pub(super) brief: DesignBrief,
    pub(super) gate: Gate,
}

/// What a designer came up with, and its name.
pub(super) struct Shift {
    pub(super) name: &'static str,
    pub(super) designed: DesignOutcome,
}

/// Lets a designer work; what it made and the gate it passed, or why it could not.
pub(super) async fn design(
    designer: Box<dyn Designer>,
    task: Task,
    stopping: watch::Receiver<()>,
) -> Result<(Shift, Gate), String> {
    let (told, done) = oneshot::channel();
    let handle = Handle::current();
    let thread = std::thread::Builder::new().name("design".to_owned());
    let begun = thread.spawn(move || {
        ThreadPriority::Background.apply();
        let work = AssertUnwindSafe(|| handle.block_on(work(designer, task, stopping)));
        let done = std::panic::catch_unwind(work).unwrap_or_else(|panic| Err(said(&*panic)));
        // Nobody listens any more where the service stops.
        drop(told.send(done));
    });
    begun.map_err(|error| format!("no thread to design on: {error}"))?;
    done.await.map_err(|_| "its thread ended".to_owned())?
}

async fn work(
    mut designer: Box<dyn Designer>,
    task: Task,
    mut stopping: watch::Receiver<()>,
) -> Result<(Shift, Gate), String> {
    let Task { brief, mut gate } = task;
    let name = designer.name();
    let designed = tokio::select! {
        // Nothing is ever sent: this ends when the worker does.
        _ = stopping.changed() => return Err("the service is stopping".to_owned()),
        designed = tokio::time::timeout(LIMIT, designer.design(&brief, &mut gate)) => designed,
    };
    let designed = designed.map_err(|_| format!("it took longer than {} s", LIMIT.as_secs()))?;
    designed.map(|designed| (Shift { name, designed }, gate)).map_err(|error| error.to_string())
}

/// What a panic said.
fn said(panic: &(dyn std::any::Any + Send)) -> String {
    let words = panic.downcast_ref::<&str>().map(|words| (*words).to_owned());
    let words = words.or_else(|| panic.downcast_ref::<String>().cloned());
    words.map_or_else(|| "it panicked".to_owned(), |words| format!("it panicked: {words}"))
}
