//! Environments that fly on the server, one a session: whoever has no `env-core` of its own steps here. There is one manager
//! for all ways in; a session that flies for a run is an implicit lease.

mod berth;
mod judged;
mod leased;
mod pass;
mod pool;
mod seat;
mod session;
pub mod vector;
mod wish;

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::Instant;

pub use self::berth::{Berths, Craft, LOOK, Lost, Mooring, Single};
pub use self::judged::Standard;
use self::leased::Leased;
pub use self::leased::TTL_S;
pub use self::pass::{Closing, Ending, Pass, Passes};
pub use self::seat::{Full, Seat, Seats, Who};
pub use self::session::{Report, Session, SessionError, Standing, Stepped};
pub use self::vector::{Source, Tally, Vector, VectorError, VectorWish};
pub use self::wish::{MOST_GROUP, Wish, WishError, Wished};
use crate::judging::Judges;
use crate::training::Desk;

/// What the manager allows.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Sessions at once.
    pub most: usize,
    /// Of these, those of one token or address.
    pub each: usize,
    /// How long a session may be silent; for ever if none.
    pub idle: Option<Duration>,
    /// Whether they may fly for runs.
    pub runs: bool,
    /// How long one whose connection dropped may be come back to.
    pub resume: Duration,
    /// Memory that the environments of all vector sessions may take together, MiB.
    pub memory_mib: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            most: 256,
            each: 64,
            idle: Some(Duration::from_secs(900)),
            runs: true,
            resume: Duration::from_secs(60),
            memory_mib: 1024,
        }
    }
}

/// A session's name, among those of whoever gave it: nobody else's is reached by it.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Named {
    whose: Option<Arc<str>>,
    name: String,
}

impl Named {
    /// This name, as they give it.
    #[must_use]
    pub fn of(who: &Who, name: impl Into<String>) -> Self {
        Self { whose: who.name.clone(), name: name.into() }
    }
}

/// A session that several requests reach by its name.
type Shared = Arc<tokio::sync::Mutex<Session>>;

/// All sessions.
#[derive(Debug)]
pub struct Sessions {
    limits: Limits,
    seats: Seats,
    /// What is free of the memory for environments, KiB.
    memory: Arc<Semaphore>,
    /// Where environments of vector sessions are stepped.
    threads: Arc<rayon::ThreadPool>,
    /// Those that may be come back to.
    berths: Berths,
    leased: Arc<Leased>,
    judges: Arc<Judges>,
    /// By name, with when each was used last.
    named: Mutex<HashMap<Named, (Shared, Instant)>>,
    closing: watch::Sender<bool>,
    passes: Passes,
}

impl Sessions {
    /// None yet.
    #[must_use]
    pub fn new(limits: Limits, desk: Desk, judges: Arc<Judges>, threads: Arc<rayon::ThreadPool>) -> Self {
        Self {
            memory: Arc::new(Semaphore::new(limits.memory_mib as usize * 1024)),
            threads,
            berths: Berths::default(),
            limits,
            seats: Seats::new(limits.most, limits.each),
            leased: Arc::new(Leased::new(desk, limits.runs)),
            judges,
            named: Mutex::default(),
            closing: watch::Sender::new(false),
            passes: Passes::default(),
        }
    }

    /// What is allowed.
    #[must_use]
    pub const fn limits(&self) -> Limits {
        self.limits
    }

    /// How many are open.
    #[must_use]
    pub fn active(&self) -> usize {
        self.seats.taken()
    }

    /// Opens one. It is closed, and its place free, when it is dropped.
    ///
    /// # Errors
    /// As many as may be are open.
    pub fn open(&self, who: &Who) -> Result<Session, Full> {
        let seat = self.seat(who)?;
        Ok(Session::new((seat, who.clone()), Arc::clone(&self.leased), Arc::clone(&self.judges)))
    }

    /// A place, free again when it is dropped.
    fn seat(&self, who: &Who) -> Result<Seat, Full> {
        self.seats.take(who).or_else(|_| {
            self.sweep();
            self.seats.take(who)
        })
    }

    /// Memory for environments, free again when it is dropped.
    fn memory(&self, bytes: usize) -> Result<OwnedSemaphorePermit, VectorError> {
        let kib = u32::try_from(bytes.div_ceil(1024)).unwrap_or(u32::MAX);
        Arc::clone(&self.memory).try_acquire_many_owned(kib).map_err(|_| VectorError::Memory {
            needed_mib: bytes.div_ceil(1 << 20),
            free_mib: self.memory.available_permits() / 1024,
            most_mib: self.limits.memory_mib as usize,
        })
    }

    /// Those that may be come back to.
    #[must_use]
    pub const fn berths(&self) -> &Berths {
        &self.berths
    }

    /// The session of a name; opened where there is none.
    ///
    /// # Errors
    /// As many as may be are open.
    pub fn named(&self, who: &Who, name: &Named) -> Result<Shared, Full> {
        if let Some(session) = self.known(name) {
            return Ok(session);
        }
        let session = Arc::new(tokio::sync::Mutex::new(self.open(who)?));
        let mut named = self.hold();
        // Two may have opened it at once: the first stays.
        let entry = named.entry(name.clone()).or_insert_with(|| (session, Instant::now()));
        Ok(Arc::clone(&entry.0))
    }

    /// The session of a name, if there is one.
    #[must_use]
    pub fn known(&self, name: &Named) -> Option<Shared> {
        self.sweep();
        let mut named = self.hold();
        let (session, used) = named.get_mut(name)?;
        *used = Instant::now();
        Some(Arc::clone(session))
    }

    /// Closes the session of a name; false if there is none.
    pub fn end(&self, name: &Named) -> bool {
        self.hold().remove(name).is_some()
    }

    /// Closes named sessions that nobody has used for too long.
    fn sweep(&self) {
        let Some(idle) = self.limits.idle else { return };
        // One that is being used is held by whoever uses it.
        self.hold().retain(|_, (session, used)| used.elapsed() < idle || Arc::strong_count(session) > 1);
    }

    fn hold(&self) -> MutexGuard<'_, HashMap<Named, (Shared, Instant)>> {
        // Nothing that holds it can panic; if something did, the map is still a map.
        self.named.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells when the service stops, or their token is worth nothing any more: whoever serves them ends it then.
    #[must_use]
    pub fn closing(&self, who: &Who) -> Closing {
        Closing::new(self.closing.subscribe(), &self.passes, who.pass())
    }

    /// By what connections came in.
    #[must_use]
    pub const fn passes(&self) -> &Passes {
        &self.passes
    }

    /// Ends all sessions. What they fly for runs is given back.
    pub async fn close(&self) {
        self.closing.send_replace(true);
        self.hold().clear();
        // Those over a socket end by themselves, which takes a moment.
        let ended = tokio::time::timeout(Duration::from_secs(2), self.seats.all_free()).await;
        if ended.is_err() {
            tracing::warn!(active = self.active(), "Some sessions did not end in time.");
        }
        self.leased.settle().await;
    }
}
