//! Signals that wake workers and listeners after a commit.

use std::sync::Arc;

use tokio::sync::{Notify, watch};

/// Receivers of work that a commit made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// Proposals wait to be prepared.
    Prepare,
    /// Episodes wait for their critique.
    Critique,
    /// A design request may be due.
    Design,
    /// A run's policy may have room in its feed.
    Rollout,
    /// A run was deleted, and its rows are left.
    Delete,
    /// Run events were emitted, or a run was deleted.
    Events,
    /// Groups were pushed to a trajectory feed.
    Feed,
    /// A run was created or deleted, or its status, policy or policy version changed.
    RunStates,
}

/// Channels of the signals; each worker and listener holds a clone of its own.
#[derive(Debug, Clone, Default)]
pub struct WorkerSignals {
    /// Wakes the worker that prepares scenarios.
    pub prepare: Arc<Notify>,
    /// Wakes the worker that criticises episodes.
    pub critique: Arc<Notify>,
    /// Wakes the worker that runs design requests.
    pub design: Arc<Notify>,
    /// Wakes the worker that rolls out policies.
    pub rollout: Arc<Notify>,
    /// Wakes the worker that deletes the rows of deleted runs.
    pub delete: Arc<Notify>,
    /// Counts the commits that emitted run events or deleted a run, for event streams.
    pub events: Arc<watch::Sender<u64>>,
    /// Counts the commits that pushed groups to a feed, for trainers that long-poll and for streams on NATS.
    pub feed: watch::Sender<u64>,
    /// Counts the commits that changed the states of runs, which are published on NATS.
    pub run_states: watch::Sender<u64>,
}

impl WorkerSignals {
    /// Sends one signal to the workers that wait for it.
    pub(crate) fn send(&self, signal: Signal) {
        match signal {
            Signal::Prepare => self.prepare.notify_one(),
            Signal::Critique => self.critique.notify_one(),
            Signal::Design => self.design.notify_one(),
            Signal::Rollout => self.rollout.notify_one(),
            Signal::Delete => self.delete.notify_one(),
            Signal::Events => self.events.send_modify(|commits| *commits += 1),
            Signal::Feed => self.feed.send_modify(|commits| *commits += 1),
            Signal::RunStates => self.run_states.send_modify(|commits| *commits += 1),
        }
    }
}
