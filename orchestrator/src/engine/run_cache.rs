//! The runs in memory.

use std::collections::HashMap;
use std::ops::{Deref, DerefMut};

use sqlx::SqliteConnection;
use store::curriculum::NewCurriculumEvent;

use crate::engine::error::ServiceError;
use crate::engine::run_state::RunState;
use clock::Millis;

/// Cache of run states, keyed by run id. It never holds a state that is ahead of what its transaction keeps: a failed change evicts
/// the runs it touched.
#[derive(Debug, Default)]
pub struct RunCache {
    runs: HashMap<String, RunState>,
    /// Runs that the change being applied has restored or changed.
    touched: Vec<String>,
}

/// State of a run in the cache. A mutable borrow marks the run as touched by the change being applied: restoring a run takes
/// milliseconds, so that a rejected request should not evict it.
#[derive(Debug)]
pub struct CachedRun<'a> {
    state: &'a mut RunState,
    touched: &'a mut Vec<String>,
}

impl<'a> CachedRun<'a> {
    /// Returns the state for reading.
    pub(crate) fn into_ref(self) -> &'a RunState {
        self.state
    }
}

impl Deref for CachedRun<'_> {
    type Target = RunState;

    fn deref(&self) -> &RunState {
        self.state
    }
}

impl DerefMut for CachedRun<'_> {
    fn deref_mut(&mut self) -> &mut RunState {
        if !self.touched.contains(&self.state.run) {
            self.touched.push(self.state.run.clone());
        }
        self.state
    }
}

impl RunCache {
    /// Returns a run for reading or writing, restored from the store if it is not in memory.
    ///
    /// # Errors
    /// Returns [`ServiceError::UnknownRun`] if the run does not exist, and another error if it cannot be restored.
    pub async fn load(
        &mut self,
        conn: &mut SqliteConnection,
        run: &str,
    ) -> Result<CachedRun<'_>, ServiceError> {
        if !self.runs.contains_key(run) {
            let state = RunState::load(conn, run).await?;
            self.runs.insert(run.to_owned(), state);
            // The state may contain what the change wrote.
            self.touched.push(run.to_owned());
        }
        let state = self.runs.get_mut(run).ok_or_else(|| ServiceError::UnknownRun(run.to_owned()))?;
        Ok(CachedRun { state, touched: &mut self.touched })
    }

    /// Returns a run if it is in memory.
    #[must_use]
    pub fn get(&self, run: &str) -> Option<&RunState> {
        self.runs.get(run)
    }

    /// Returns the runs in memory, in no particular order.
    pub fn iter(&self) -> impl Iterator<Item = &RunState> {
        self.runs.values()
    }

    /// Shifts the times of all runs in memory by `by` milliseconds, after the system clock jumped and the store was shifted.
    pub(crate) fn shift_times(&mut self, by: Millis) {
        self.runs.values_mut().for_each(|state| state.shift_times(by));
    }

    /// Evicts a run that the current change deletes.
    pub(crate) fn evict(&mut self, run: &str) {
        self.runs.remove(run);
    }

    /// Starts a new change: no run is touched yet.
    pub(crate) fn begin_change(&mut self) {
        self.touched.clear();
    }

    /// Takes the curriculum events that the current change made and that are not written yet, by run.
    pub(crate) fn take_unwritten(&mut self) -> Vec<(String, Vec<NewCurriculumEvent>)> {
        let mut taken = Vec::new();
        for run in &self.touched {
            if let Some(state) = self.runs.get_mut(run) {
                let events = state.take_unwritten();
                if !events.is_empty() {
                    taken.push((run.clone(), events));
                }
            }
        }
        taken
    }

    /// Evicts the runs that the current change touched: they are restored when next needed.
    pub(crate) fn evict_touched(&mut self) {
        for run in self.touched.drain(..) {
            self.runs.remove(&run);
        }
    }

    /// Evicts all runs from the cache.
    pub(crate) fn clear(&mut self) {
        self.touched.clear();
        self.runs.clear();
    }

    /// Returns every run in memory and ends the cache.
    pub(crate) fn into_states(self) -> impl Iterator<Item = RunState> {
        self.runs.into_values()
    }
}

#[cfg(test)]
mod tests {
    use api_types::RunRequest;
    use clock::Clock;

    use super::*;
    use crate::engine::change::Change;
    use crate::engine::signals::WorkerSignals;
    use crate::engine::write_tx::WriteTx;
    use crate::engine::writer::Writer;
    use crate::runs::create_run::CreateRun;
    use crate::shards::Shards;

    const RUN: &str = "run";

    /// Opens the run, changes it if `changes` is true, and fails.
    struct Fail {
        changes: bool,
    }

    impl Change for Fail {
        type Output = ();

        async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
            let mut run = tx.run(RUN).await?;
            if self.changes {
                run.state.policy_version = 7;
            }
            Err(ServiceError::invalid("groups", "must be fewer"))
        }
    }

    /// Tells whether the run is in memory, then opens it and returns its policy version.
    struct Look;

    impl Change for Look {
        type Output = (bool, i64);

        async fn apply(self, tx: &mut WriteTx) -> Result<(bool, i64), ServiceError> {
            let is_cached = tx.runs.get(RUN).is_some();
            Ok((is_cached, tx.run(RUN).await?.state.policy_version))
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn only_changed_runs_are_evicted_by_a_failed_change() {
        let folder = tempfile::tempdir().unwrap();
        let conn = store::open_writer(&folder.path().join("db")).await.unwrap();
        let (writer, _task) = Writer::start(conn, None, Clock::manual(1_000).clock, WorkerSignals::default());
        let request = RunRequest { id: Some(RUN.to_owned()), ..RunRequest::default() };
        writer.change(CreateRun::from_request(&request, &Shards::default()).unwrap()).await.unwrap();
        for (changes, is_cached) in [(false, true), (true, false), (false, true)] {
            assert!(writer.change(Fail { changes }).await.is_err());
            assert_eq!(writer.change(Look).await.unwrap(), (is_cached, 0), "changes: {changes}");
        }
    }
}
