//! Places for sessions: so many in all, and so many for each who comes.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::OwnedSemaphorePermit;

/// Who opens a session, as its limits see it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Who {
    /// A token or an address; none where nobody is told apart.
    pub name: Option<Arc<str>>,
    /// The token's number, where it is one.
    pub token: Option<i64>,
    /// Whether they may fly for runs.
    pub runs: bool,
}

impl Who {
    /// Whoever it is on this machine.
    #[must_use]
    pub const fn anybody() -> Self {
        Self { name: None, token: None, runs: true }
    }
}

/// How many places each has.
#[derive(Debug, Clone, Default)]
pub(super) struct Taken(Arc<Mutex<HashMap<Arc<str>, usize>>>);

/// A place, free again when it is dropped.
#[derive(Debug)]
pub(super) struct Seat {
    _of_all: OwnedSemaphorePermit,
    mine: Option<(Taken, Arc<str>)>,
}

impl Taken {
    /// One more for them, where they have fewer than this; else how many they have.
    pub(super) fn take(&self, who: &Who, each: usize, of_all: OwnedSemaphorePermit) -> Result<Seat, usize> {
        let Some(name) = &who.name else { return Ok(Seat { _of_all: of_all, mine: None }) };
        let mut taken = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let count = taken.entry(Arc::clone(name)).or_default();
        if *count >= each {
            return Err(*count);
        }
        *count += 1;
        Ok(Seat { _of_all: of_all, mine: Some((self.clone(), Arc::clone(name))) })
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        let Some((Taken(taken), name)) = &self.mine else { return };
        let mut taken = taken.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = taken.get_mut(name) {
            *count -= 1;
            if *count == 0 {
                taken.remove(name);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use tokio::sync::Semaphore;

    use super::*;

    #[test]
    fn each_has_so_many_and_gives_them_back() {
        let (all, taken) = (Arc::new(Semaphore::new(10)), Taken::default());
        let who = |name: &str| Who { name: Some(name.into()), token: None, runs: false };
        let take = |who: &Who| taken.take(who, 2, Arc::clone(&all).try_acquire_owned().expect("a place"));
        let first = take(&who("a")).expect("one");
        let _second = take(&who("a")).expect("two");
        assert_eq!(take(&who("a")).err(), Some(2));
        assert!(take(&who("b")).is_ok());
        for _ in 0..3 {
            assert!(take(&Who::anybody()).is_ok());
        }
        drop(first);
        assert!(take(&who("a")).is_ok());
        assert_eq!(all.available_permits(), 9, "what was refused holds no place");
    }
}
