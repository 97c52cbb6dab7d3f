//! [`RunEnd`]: tells sessions that their run was deleted.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};

use parking_lot::Mutex;
use store::ids::RunId;

/// Flag of a run that all of its sessions share.
#[derive(Debug, Clone, Default)]
pub(crate) struct RunEnd(Arc<AtomicBool>);

impl RunEnd {
    /// Returns true if the run was deleted.
    pub(crate) fn is_deleted(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Flags of the runs with sessions.
#[derive(Debug, Default)]
pub(super) struct RunEnds(Mutex<HashMap<RunId, Weak<AtomicBool>>>);

impl RunEnds {
    /// Returns the flag of a run. A session takes it before its lease, so that it misses no deletion.
    pub(super) fn of(&self, run: &RunId) -> RunEnd {
        let mut flags = self.0.lock();
        if let Some(flag) = flags.get(run).and_then(Weak::upgrade) {
            return RunEnd(flag);
        }
        flags.retain(|_, flag| flag.strong_count() > 0);
        let end = RunEnd::default();
        flags.insert(run.clone(), Arc::downgrade(&end.0));
        end
    }

    /// Sets the flag of a run that was deleted. A later run with the same id gets another flag.
    pub(super) fn set(&self, run: &RunId) {
        if let Some(flag) = self.0.lock().remove(run).and_then(|flag| flag.upgrade()) {
            flag.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deletion_reaches_the_sessions_of_one_run() {
        let (ends, run, other): (_, RunId, RunId) =
            (RunEnds::default(), "a".parse().unwrap(), "b".parse().unwrap());
        let (first, second, elsewhere) = (ends.of(&run), ends.of(&run), ends.of(&other));
        ends.set(&run);
        assert_eq!([&first, &second, &elsewhere].map(RunEnd::is_deleted), [true, true, false]);
        assert!(!ends.of(&run).is_deleted(), "a later run with this id");
    }
}
