//! All episodes, some at a time.

use std::io::Write;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use llm::LlmError;
use futures_util::StreamExt;
use tokio::sync::watch;

use super::episode::{self, Fault, Flown, Job};
use super::pilot::{PilotError, Wish};
use super::record::Output;
use orchestrator::policy::ActionCodec;

/// Episodes in a row that do not begin, after which no other is tried; as many as are flown at once, if those are more.
const NOBODY: usize = 3;

/// An episode that is to be flown, with its task's actions.
#[derive(Debug)]
pub(super) struct Planned<'a> {
    pub(super) job: Job<'a>,
    pub(super) actions: &'a ActionCodec,
}

/// Flies them in order, so many at a time; how each went, and none for those that were not begun.
pub(super) async fn fly(
    planned: &[Planned<'_>],
    wish: &Wish,
    output: &Output,
    at_once: usize,
    stop: &watch::Receiver<bool>,
) -> anyhow::Result<Vec<Option<Flown>>> {
    let watch = Watch { patience: at_once.max(NOBODY) as u64, ..Watch::default() };
    let flights = planned.iter().enumerate().map(|(place, planned)| {
        let (watch, mut stop) = (&watch, stop.clone());
        async move {
            if watch.hopeless.load(Ordering::Relaxed) || *stop.borrow() {
                return anyhow::Ok((place, None));
            }
            let pilot = wish.pilot(planned.job.task, planned.actions, planned.job.number)?;
            let mut tape = output.tape();
            let flown = episode::fly(&planned.job, pilot, &mut tape, &mut stop).await;
            if watch.see(&flown) {
                say(&planned.job, &flown);
            }
            Ok((place, Some(flown)))
        }
    });
    let mut all: Vec<Option<Flown>> = planned.iter().map(|_| None).collect();
    let mut flights = futures_util::stream::iter(flights).buffer_unordered(at_once);
    while let Some(flown) = flights.next().await {
        let (place, flown) = flown?;
        all[place] = flown;
    }
    Ok(all)
}

/// Whether there is any use in beginning another episode.
#[derive(Debug, Default)]
struct Watch {
    steps: AtomicU64,
    /// Episodes in a row that did not get to a first step, and how many are borne.
    in_vain: AtomicU64,
    patience: u64,
    hopeless: AtomicBool,
}

impl Watch {
    /// Takes note of an episode; whether anything was flown until now. Where nothing ever is, the command ends with what
    /// went wrong first, and that is all there is to say.
    fn see(&self, flown: &Flown) -> bool {
        let steps = flown.rewards.len() as u64;
        let before = self.steps.fetch_add(steps, Ordering::Relaxed);
        let closed = matches!(&flown.fault, Some(Fault::Pilot(PilotError::Model(LlmError::CircuitOpen { .. }))));
        let output = matches!(&flown.fault, Some(Fault::Output(_)));
        let in_vain = if steps == 0 && flown.fault.is_some() {
            self.in_vain.fetch_add(1, Ordering::Relaxed) + 1
        } else {
            self.in_vain.store(0, Ordering::Relaxed);
            0
        };
        // Nobody is there (any more), or the endpoint is left alone for a while: further episodes would fare likewise.
        if flown.fault.is_some() && (before + steps == 0 || in_vain >= self.patience || closed || output) {
            self.hopeless.store(true, Ordering::Relaxed);
        }
        before + steps > 0
    }
}

/// How an episode went, in a line on stderr.
fn say(job: &Job<'_>, flown: &Flown) {
    let Job { number, task, .. } = job;
    let steps = flown.rewards.len();
    let held =
        if flown.held > 0 { format!(", {} of them without an action", flown.held) } else { String::new() };
    let how = match &flown.fault {
        None => format!("score {:.3} after {steps} steps{held}", flown.score),
        Some(fault) => format!("not flown to its end ({steps} steps{held}): {fault}"),
    };
    // Progress is worth no failure.
    let _ = writeln!(std::io::stderr().lock(), "Episode {number}, {}: {how}", task.name);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::play::session::SessionError;

    /// A server that hangs after a while is not tried for every episode that is left.
    #[test]
    fn episodes_that_do_not_begin_are_borne_for_a_while() {
        let watch = Watch { patience: 3, ..Watch::default() };
        let late = || Flown { fault: Some(SessionError::Late { after_s: 1 }.into()), ..Flown::default() };
        let flown = || Flown { rewards: vec![0.0], ..Flown::default() };
        for episode in [flown(), late(), late(), flown(), late(), late()] {
            watch.see(&episode);
            assert!(!watch.hopeless.load(Ordering::Relaxed));
        }
        watch.see(&late());
        assert!(watch.hopeless.load(Ordering::Relaxed));
    }
}
