//! Places for sessions: so many in all, and so many for each who comes.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::Pass;

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

    /// By what they came in; none where they may whether there are tokens or not.
    pub(super) fn pass(&self) -> Option<Pass> {
        let without = self.name.is_none().then_some(None);
        self.token.map(Some).or(without)
    }
}

/// As many as may be are open: in all, or of those who ask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("Server at capacity: {active}/{most} sessions active. Cannot accept new connections.")]
pub struct Full {
    /// How many are open.
    pub active: usize,
    /// How many may be.
    pub most: usize,
}

/// Places: so many in all, and of these so many for each who comes.
#[derive(Debug)]
pub struct Seats {
    all: Arc<Semaphore>,
    taken: Taken,
    most: usize,
    each: usize,
}

/// How many places each has.
#[derive(Debug, Clone, Default)]
struct Taken(Arc<Mutex<HashMap<Arc<str>, usize>>>);

/// A place, free again when it is dropped.
#[derive(Debug)]
pub struct Seat {
    _of_all: OwnedSemaphorePermit,
    mine: Option<(Taken, Arc<str>)>,
}

impl Seats {
    /// All free.
    #[must_use]
    pub fn new(most: usize, each: usize) -> Self {
        let most = most.min(u32::MAX as usize).min(Semaphore::MAX_PERMITS);
        Self { all: Arc::new(Semaphore::new(most)), taken: Taken::default(), most, each }
    }

    /// How many are taken.
    #[must_use]
    pub fn taken(&self) -> usize {
        self.most.saturating_sub(self.all.available_permits())
    }

    /// One more for them.
    ///
    /// # Errors
    /// As many as may be are taken, in all or of theirs.
    pub fn take(&self, who: &Who) -> Result<Seat, Full> {
        let of_all = Arc::clone(&self.all).try_acquire_owned();
        let of_all = of_all.map_err(|_| Full { active: self.taken(), most: self.most })?;
        let Some(name) = &who.name else { return Ok(Seat { _of_all: of_all, mine: None }) };
        let mut taken = self.taken.0.lock().unwrap_or_else(PoisonError::into_inner);
        let count = taken.entry(Arc::clone(name)).or_default();
        if *count >= self.each {
            return Err(Full { active: *count, most: self.each });
        }
        *count += 1;
        Ok(Seat { _of_all: of_all, mine: Some((self.taken.clone(), Arc::clone(name))) })
    }

    /// Waits until all are free.
    pub async fn all_free(&self) {
        let all = u32::try_from(self.most).unwrap_or(u32::MAX);
        drop(self.all.acquire_many(all).await); // they are never closed
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
    use super::*;

    #[test]
    fn each_has_so_many_and_gives_them_back() {
        let seats = Seats::new(10, 2);
        let who = |name: &str| Who { name: Some(name.into()), token: None, runs: false };
        let first = seats.take(&who("a")).expect("one");
        let _second = seats.take(&who("a")).expect("two");
        assert_eq!(seats.take(&who("a")).err(), Some(Full { active: 2, most: 2 }));
        assert!(seats.take(&who("b")).is_ok());
        for _ in 0..3 {
            assert!(seats.take(&Who::anybody()).is_ok());
        }
        drop(first);
        assert_eq!(seats.taken(), 1, "what was refused holds no place");
        assert!(seats.take(&who("a")).is_ok());
        let all: Vec<Seat> = (0..9).map(|_| seats.take(&Who::anybody()).expect("a place")).collect();
        assert_eq!(seats.take(&who("c")).err(), Some(Full { active: 10, most: 10 }));
        drop(all);
    }
}
