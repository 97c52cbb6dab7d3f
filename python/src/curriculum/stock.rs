//! What was fetched and is not flown yet, what was flown and is not handed in yet, and who waits for what.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use env_core::Scenario;
use env_core::batch::book::{Flown, Pool, Tape};
use serde::Serialize;

use super::lease::{Episode, Episodes, Lease};

/// What became of everything, in episodes.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Tally {
    /// Leases that were taken.
    pub(super) leases: u64,
    /// Flown to their end.
    pub(super) flown: u64,
    /// Claimed in columns that the server accepted, once what it audited earned what was claimed.
    pub(super) accepted: u64,
    /// Claimed in columns that the server refused, since a log did not earn what was claimed; and whole logs that it refused.
    pub(super) refused: u64,
    /// Claimed in columns whose audit was not over in time.
    pub(super) unproven: u64,
    /// Whole logs that were counted, and kept as a statistic.
    pub(super) counted: u64,
    pub(super) stored: u64,
    /// Handed in before, or after their lease was over.
    pub(super) duplicate: u64,
    pub(super) late: u64,
    /// Not flown to their end, and given back or given up.
    pub(super) unflown: u64,
    /// Flown, but not handed in when the curriculum was closed.
    pub(super) lost: u64,
}

/// A lease of columns that is being flown.
#[derive(Debug)]
pub(super) struct Ledger {
    pub(super) lease: Arc<Lease>,
    pub(super) flown: Vec<Option<Line>>,
    pub(super) open: usize,
    /// The oldest policy that flew any of it.
    pub(super) version: u32,
}

/// One episode of it.
#[derive(Debug)]
pub(super) struct Line {
    pub(super) score: f64,
    pub(super) tape: Tape,
}

/// What is to be handed in.
#[derive(Debug)]
pub(super) enum Parcel {
    /// A lease of columns, as far as it was flown.
    Columns(Ledger),
    /// An episode of a lease of groups.
    Result {
        /// Which.
        episode: Episode,
        /// What was done.
        tape: Tape,
        /// By whom.
        version: u32,
    },
    /// What is left of a lease is given back.
    Release(Arc<Lease>),
}

impl Parcel {
    /// Episodes in it.
    pub(super) fn episodes(&self) -> usize {
        match self {
            Self::Columns(ledger) => ledger.flown.iter().flatten().count(),
            Self::Result { .. } => 1,
            Self::Release(_) => 0,
        }
    }
}

/// A lease of groups.
#[derive(Debug)]
pub(super) struct Groups {
    pub(super) lease: Arc<Lease>,
    /// Its episodes that are neither flown nor given up.
    open: usize,
    /// Those that were flown and are not handed in yet.
    untold: usize,
    /// Somebody gave some of it up.
    torn: bool,
}

/// Everything that trainers and the two threads share.
#[derive(Debug, Default)]
pub(super) struct Stock {
    pub(super) version: u32,
    pub(super) fetched: VecDeque<Episodes>,
    returned: Vec<(Episode, Scenario)>,
    ledgers: BTreeMap<String, Ledger>,
    groups: BTreeMap<String, Groups>,
    pub(super) outbox: VecDeque<Parcel>,
    /// Episodes in the outbox, those that are being sent included.
    pub(super) waiting: usize,
    /// Episodes that should be ready at any time.
    pub(super) wanted: usize,
    /// The run is paused: in words.
    pub(super) paused: Option<String>,
    /// Since when the server is away, and how that shows.
    pub(super) away: Option<(Instant, String)>,
    /// Why nothing more will come.
    pub(super) fault: Option<String>,
    /// How the server ended, where it is one that this process started.
    pub(super) gone: Option<String>,
    /// There are no more episodes: an evaluation is flown.
    pub(super) exhausted: bool,
    pub(super) closing: bool,
    /// A lease is being asked for.
    pub(super) asking: bool,
    /// Something is being sent.
    pub(super) sending: bool,
    /// Nobody waits any more for what is being sent.
    pub(super) abandoned: bool,
    /// What was being sent is told, and nothing more will be.
    pub(super) ended: bool,
    pub(super) tally: Tally,
}

impl Stock {
    /// Episodes that can be begun at once.
    pub(super) fn ready(&self) -> usize {
        self.returned.len() + self.fetched.iter().map(|episodes| episodes.left).sum::<usize>()
    }

    /// Episodes that are flown, of leases of columns that are not yet whole.
    pub(super) fn unclaimed(&self) -> usize {
        self.ledgers.values().map(|ledger| ledger.flown.iter().flatten().count()).sum()
    }

    /// Whether anything can come of it still.
    ///
    /// # Errors
    /// Why not.
    pub(super) fn usable(&self) -> Result<(), String> {
        if self.closing {
            return Err("the curriculum is closed".to_owned());
        }
        self.fault.clone().map_or(Ok(()), Err)
    }

    /// Why nothing more will come, and how much the server did not take.
    pub(super) fn trouble(&self) -> Option<String> {
        let fault = self.fault.as_ref()?;
        Some(match self.tally.refused {
            0 => fault.clone(),
            refused => format!("{fault}; refused in all: {refused} episodes"),
        })
    }

    /// The server answers.
    pub(super) fn answered(&mut self) {
        (self.away, self.gone) = (None, None);
    }

    /// Nobody waits for what is not handed in; how many episodes that are.
    pub(super) fn forsake(&mut self) -> usize {
        let lost = if self.ended { 0 } else { std::mem::take(&mut self.waiting) };
        self.abandoned = true;
        self.tally.lost += lost as u64;
        self.outbox.retain(|parcel| parcel.episodes() == 0);
        lost
    }

    /// What comes first, which stays; all of a run's kessler have one shape, and so have all of its docking.
    pub(super) fn first(&self) -> Option<Scenario> {
        let returned = self.returned.last().map(|(_, scenario)| scenario.clone());
        returned.or_else(|| self.fetched.front().and_then(Episodes::first))
    }

    /// A lease came.
    pub(super) fn add(&mut self, episodes: Episodes) {
        let lease = Arc::clone(&episodes.lease);
        self.tally.leases += 1;
        if lease.columns {
            let flown = (0..lease.episodes).map(|_| None).collect();
            let (open, version) = (lease.episodes, lease.version);
            self.ledgers.insert(lease.id.clone(), Ledger { lease, flown, open, version });
        } else {
            let open = lease.episodes;
            self.groups.insert(lease.id.clone(), Groups { lease, open, untold: 0, torn: false });
        }
        self.fetched.push_back(episodes);
    }

    /// An episode was flown to its end.
    pub(super) fn flown(&mut self, flown: Flown<Episode>) {
        let Flown { name: episode, scenario, tape, earned, version } = flown;
        let range = scenario.task().score_range();
        let score = earned.clamp(range.min, range.max);
        self.tally.flown += 1;
        if !episode.lease.columns {
            if let Some(groups) = self.groups.get_mut(&episode.lease.id) {
                groups.open = groups.open.saturating_sub(1);
                groups.untold += 1;
            }
            self.post(Parcel::Result { episode, tape, version });
            return;
        }
        let Some(ledger) = self.ledgers.get_mut(&episode.lease.id) else { return };
        ledger.version = ledger.version.min(version);
        if let Some(line) = ledger.flown.get_mut(episode.index).filter(|line| line.is_none()) {
            *line = Some(Line { score, tape });
            ledger.open -= 1;
        }
        self.claim_if_whole(&episode.lease);
    }

    /// An episode will not be flown to its end by anybody.
    pub(super) fn abandon(&mut self, episode: &Episode) {
        if let Some(groups) = self.groups.get_mut(&episode.lease.id) {
            (groups.open, groups.torn) = (groups.open.saturating_sub(1), true);
            self.tally.unflown += 1;
            self.release_if_done(&episode.lease);
        } else if let Some(ledger) = self.ledgers.get_mut(&episode.lease.id) {
            ledger.open = ledger.open.saturating_sub(1);
            self.tally.unflown += 1;
            self.claim_if_whole(&episode.lease);
        }
    }

    /// An episode of a lease of groups is handed in.
    pub(super) fn told(&mut self, lease: &Lease) {
        if let Some(groups) = self.groups.get_mut(&lease.id) {
            groups.untold = groups.untold.saturating_sub(1);
            self.release_if_done(lease);
        }
    }

    /// What waits to be handed in.
    fn post(&mut self, parcel: Parcel) {
        self.waiting += parcel.episodes();
        self.outbox.push_back(parcel);
    }

    fn claim_if_whole(&mut self, lease: &Lease) {
        if self.ledgers.get(&lease.id).is_some_and(|ledger| ledger.open == 0)
            && let Some(ledger) = self.ledgers.remove(&lease.id)
        {
            self.post(Parcel::Columns(ledger));
        }
    }

    /// A lease all of which was handed in is over by itself; one of which some was given up is given back.
    fn release_if_done(&mut self, lease: &Lease) {
        if self.groups.get(&lease.id).is_some_and(|groups| groups.open + groups.untold == 0)
            && let Some(Groups { lease, torn: true, .. }) = self.groups.remove(&lease.id)
        {
            self.post(Parcel::Release(lease));
        }
    }

    /// Nothing more is flown: what was begun of columns is claimed as far as it goes, the rest is given back.
    pub(super) fn give_up(&mut self) {
        self.fetched.clear();
        self.returned.clear();
        for (_, ledger) in std::mem::take(&mut self.ledgers) {
            self.tally.unflown += ledger.open as u64;
            let begun = ledger.flown.iter().any(Option::is_some);
            let parcel =
                if begun { Parcel::Columns(ledger) } else { Parcel::Release(Arc::clone(&ledger.lease)) };
            self.post(parcel);
        }
        for (_, Groups { lease, open, .. }) in std::mem::take(&mut self.groups) {
            self.tally.unflown += open as u64;
            self.post(Parcel::Release(lease));
        }
    }

    /// Leases of which something is still to be flown.
    pub(super) fn active(&self) -> Vec<Arc<Lease>> {
        let columns = self.ledgers.values().map(|ledger| &ledger.lease);
        columns.chain(self.groups.values().map(|groups| &groups.lease)).map(Arc::clone).collect()
    }
}

impl Pool for Stock {
    type Name = Episode;

    fn take(&mut self) -> Option<(Episode, Scenario)> {
        if let Some(returned) = self.returned.pop() {
            return Some(returned);
        }
        loop {
            let episodes = self.fetched.front_mut()?;
            match episodes.next() {
                Some(next) => return Some(next),
                None => {
                    self.fetched.pop_front();
                }
            }
        }
    }

    fn give_back(&mut self, episode: Episode, scenario: Scenario) {
        if !self.closing {
            self.returned.push((episode, scenario));
        }
    }
}

/// The stock, and who waits for a change of it.
#[derive(Debug, Default)]
pub(super) struct Shared {
    stock: Mutex<Stock>,
    changed: Condvar,
}

impl Shared {
    pub(super) fn lock(&self) -> MutexGuard<'_, Stock> {
        // Nothing that holds it can panic; if something did, what is in stock still is.
        self.stock.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a change, at most so long.
    pub(super) fn wait<'a>(&self, stock: MutexGuard<'a, Stock>, most: Duration) -> MutexGuard<'a, Stock> {
        self.changed.wait_timeout(stock, most).unwrap_or_else(PoisonError::into_inner).0
    }

    /// Tells all who wait.
    pub(super) fn tell(&self) {
        self.changed.notify_all();
    }
}
