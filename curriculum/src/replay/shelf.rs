//! The scenarios of a task that are worth facing again, in the order of what they still have to teach.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use env_core::Draws;
use serde::{Deserialize, Serialize};

/// What each visit without a gain leaves of a priority.
const DECAY: f64 = 0.7;
/// Visits from which a scenario on which the agent does not get better decays.
const PATIENCE: u32 = 3;
/// The least by which a mean score must beat the best before to be a gain: a hundredth of the scores' range.
const GAIN: f64 = 0.01;

/// A scenario on the shelf.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Entry {
    /// The level at which it was drawn, its ancestor's if it was edited.
    pub(super) level: Option<u32>,
    /// Outcomes observed.
    pub(super) visits: u32,
    /// Mean over visits of what it has to teach.
    pub(super) worth: f64,
    /// The best mean score of a visit.
    best: f64,
    /// Visits since then.
    stalled: u32,
    /// Edits between it and a scenario as it was drawn.
    pub(super) generation: u32,
}

impl Entry {
    /// One that was seen once.
    pub(super) const fn seen(level: Option<u32>, visit: Visit, generation: u32) -> Self {
        Self { level, visits: 1, worth: visit.worth, best: visit.score, stalled: 0, generation }
    }

    fn take(&mut self, visit: Visit) {
        self.visits = self.visits.saturating_add(1);
        self.worth += (visit.worth - self.worth) / f64::from(self.visits);
        if visit.score > self.best + GAIN {
            (self.best, self.stalled) = (visit.score, 0);
        } else {
            self.stalled = self.stalled.saturating_add(1);
        }
    }

    /// How much it is worth to face it again. A reference with hindsight leaves gaps that no agent can close: what was tried
    /// often and went no better is worth less each time.
    pub(super) fn priority(&self) -> f64 {
        let waited = if self.visits >= PATIENCE { self.stalled.saturating_sub(PATIENCE - 1) } else { 0 };
        self.worth * DECAY.powi(i32::try_from(waited.min(64)).unwrap_or(64))
    }
}

/// What a visit found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Visit {
    /// What the scenario has to teach.
    pub(super) worth: f64,
    /// The mean score.
    pub(super) score: f64,
}

/// The shelf of a task.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "Stored", into = "Stored")]
pub(super) struct Shelf {
    /// By the seq of the proposal that made the scenario.
    entries: BTreeMap<u64, Entry>,
    /// Priorities and seqs, the highest first, the newer first among equals.
    order: Vec<(f64, u64)>,
    /// Seqs, in order, each with the one at which it was proposed last.
    lasts: Vec<(u64, u64)>,
    /// The sum of those.
    sum: u64,
}

/// As it is stored: what was proposed last when, and the rest follows.
#[derive(Clone, Serialize, Deserialize)]
struct Stored(Vec<(u64, u64, Entry)>);

impl From<Stored> for Shelf {
    fn from(Stored(stored): Stored) -> Self {
        let mut shelf = Self::default();
        for (seq, last, entry) in stored {
            shelf.put(seq, last, entry);
        }
        shelf
    }
}

impl From<Shelf> for Stored {
    fn from(shelf: Shelf) -> Self {
        let last = |seq: u64| shelf.last(seq).unwrap_or(seq);
        Self(shelf.entries.iter().map(|(seq, entry)| (*seq, last(*seq), *entry)).collect())
    }
}

/// How two stand to each other: priority and seq.
fn before(a: (f64, u64), b: (f64, u64)) -> Ordering {
    b.0.total_cmp(&a.0).then(b.1.cmp(&a.1))
}

impl Shelf {
    pub(super) const fn len(&self) -> usize {
        self.order.len()
    }

    pub(super) fn get(&self, seq: u64) -> Option<&Entry> {
        self.entries.get(&seq)
    }

    /// The seq at which one was proposed last.
    fn last(&self, seq: u64) -> Option<u64> {
        let at = self.lasts.binary_search_by_key(&seq, |(seq, _)| *seq).ok()?;
        self.lasts.get(at).map(|(_, last)| *last)
    }

    /// The highest first.
    pub(super) fn entries(&self) -> impl Iterator<Item = (u64, &Entry)> {
        self.order.iter().filter_map(|(_, seq)| Some((*seq, self.entries.get(seq)?)))
    }

    fn unorder(&mut self, key: (f64, u64)) {
        if let Ok(at) = self.order.binary_search_by(|other| before(*other, key)) {
            self.order.remove(at);
        }
    }

    fn order(&mut self, key: (f64, u64)) {
        if let Err(at) = self.order.binary_search_by(|other| before(*other, key)) {
            self.order.insert(at, key);
        }
    }

    fn put(&mut self, seq: u64, last: u64, entry: Entry) {
        if self.entries.insert(seq, entry).is_none() {
            self.order((entry.priority(), seq));
            if let Err(at) = self.lasts.binary_search_by_key(&seq, |(seq, _)| *seq) {
                self.lasts.insert(at, (seq, last));
                self.sum += last;
            }
        }
    }

    /// Takes a scenario that was seen for the first time, if it has anything to teach and is among the best `capacity`.
    pub(super) fn add(&mut self, seq: u64, entry: Entry, capacity: usize) {
        if entry.worth > 0.0 && !self.entries.contains_key(&seq) {
            self.put(seq, seq, entry);
            self.shrink(capacity);
        }
    }

    /// Takes what a visit of one that is there found; whether it is there.
    pub(super) fn visit(&mut self, seq: u64, visit: Visit) -> bool {
        let Some(entry) = self.entries.get_mut(&seq) else { return false };
        let (before, after) = (entry.priority(), {
            entry.take(visit);
            entry.priority()
        });
        self.unorder((before, seq));
        self.order((after, seq));
        true
    }

    /// Notes that one is proposed again.
    pub(super) fn proposed(&mut self, seq: u64, now: u64) {
        if let Ok(at) = self.lasts.binary_search_by_key(&seq, |(seq, _)| *seq) {
            let (_, last) = &mut self.lasts[at];
            self.sum = self.sum - *last + now;
            *last = now;
        }
    }

    /// Lets the lowest go where there are more.
    pub(super) fn shrink(&mut self, capacity: usize) {
        for (_, seq) in self.order.split_off(capacity.min(self.order.len())) {
            self.entries.remove(&seq);
            if let Ok(at) = self.lasts.binary_search_by_key(&seq, |(seq, _)| *seq) {
                self.sum -= self.lasts.remove(at).1;
            }
        }
    }

    /// One to face again: with probability `staleness` by how long ago it was proposed, else by rank (Jiang et al. 2021,
    /// equations 2 to 4).
    pub(super) fn draw(
        &self,
        draws: &mut Draws,
        ranks: &mut Ranks,
        (now, staleness): (u64, f64),
    ) -> Option<u64> {
        if draws.chance(staleness) {
            self.stalest(draws.uniform(), now)
        } else {
            self.order.get(ranks.draw(self.order.len(), draws.uniform())).map(|(_, seq)| *seq)
        }
    }

    /// By the number of events since it was proposed last.
    fn stalest(&self, draw: f64, now: u64) -> Option<u64> {
        let all = (now * self.lasts.len() as u64).saturating_sub(self.sum);
        let mut left = draw * all as f64;
        let found = self.lasts.iter().find(|(_, last)| {
            left -= now.saturating_sub(*last) as f64;
            left < 0.0
        });
        found.or(self.lasts.first()).map(|(seq, _)| *seq)
    }
}

/// The weights of ranks, (1/rank)^(1/β), added up: the same whatever stands at them.
#[derive(Debug, Clone)]
pub(super) struct Ranks {
    power: f64,
    sums: Vec<f64>,
}

impl Ranks {
    pub(super) const fn new(beta: f64) -> Self {
        Self { power: -1.0 / beta, sums: Vec::new() }
    }

    /// The place among `len` on which a draw falls.
    fn draw(&mut self, len: usize, draw: f64) -> usize {
        while self.sums.len() < len {
            let rank = self.sums.len() as f64 + 1.0;
            let before = self.sums.last().copied().unwrap_or(0.0);
            self.sums.push(before + libm::pow(rank, self.power));
        }
        let sums = &self.sums[..len];
        let left = draw * sums.last().copied().unwrap_or(0.0);
        sums.partition_point(|sum| *sum <= left).min(len.saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use env_core::draws::Purpose;

    use super::*;

    fn visit(worth: f64, score: f64) -> Visit {
        Visit { worth, score }
    }

    fn of(worths: &[f64]) -> Shelf {
        let mut shelf = Shelf::default();
        for (seq, worth) in (0..).zip(worths) {
            shelf.add(seq, Entry::seen(None, visit(*worth, 0.0), 0), 100);
        }
        shelf
    }

    fn order(shelf: &Shelf) -> Vec<u64> {
        shelf.entries().map(|(seq, _)| seq).collect()
    }

    #[test]
    fn the_most_promising_stand_first_and_the_least_leave() {
        let mut shelf = of(&[0.2, 0.9, 0.0, 0.5, 0.9]);
        assert_eq!(order(&shelf), [4, 1, 3, 0], "nothing to learn is not kept; the newer first among equals");
        shelf.shrink(3);
        assert_eq!(order(&shelf), [4, 1, 3]);
        shelf.add(9, Entry::seen(None, visit(0.1, 0.0), 0), 3);
        assert_eq!(order(&shelf), [4, 1, 3], "it is worth less than all that are there");
        assert!(shelf.get(9).is_none());
    }

    #[test]
    fn worth_is_the_mean_over_visits() {
        let mut shelf = of(&[0.9, 0.6]);
        assert!(shelf.visit(0, visit(0.1, 0.5)));
        assert!((shelf.get(0).unwrap().worth - 0.5).abs() < 1e-12);
        assert_eq!(order(&shelf), [1, 0]);
        assert!(!shelf.visit(77, visit(0.5, 0.5)));
    }

    #[test]
    fn what_no_agent_can_close_decays_and_what_gets_better_does_not() {
        let mut shelf = of(&[0.8, 0.8]);
        for round in 1..10 {
            shelf.visit(0, visit(0.8, 0.0));
            shelf.visit(1, visit(0.8, 0.05 * f64::from(round)));
        }
        assert!((shelf.get(1).unwrap().priority() - 0.8).abs() < 1e-12);
        let decayed = shelf.get(0).unwrap().priority();
        assert!((decayed - 0.8 * 0.7f64.powi(7)).abs() < 1e-12, "{decayed}");
        assert_eq!(order(&shelf), [1, 0]);
    }

    #[test]
    fn stored_and_read_it_is_the_same() {
        let mut shelf = of(&[0.3, 0.8, 0.8, 0.1]);
        shelf.proposed(2, 40);
        shelf.visit(1, visit(0.1, 0.4));
        let back: Shelf = serde_json::from_value(serde_json::to_value(&shelf).unwrap()).unwrap();
        assert_eq!(back, shelf);
    }

    /// Shares of 20 000 draws against (1/rank)^(1/β), four standard deviations at most.
    #[test]
    fn validate_ranks_are_drawn_by_their_weights() {
        let shelf = of(&[0.1, 0.2, 0.3, 0.4, 0.5]);
        for beta in [0.3, 1.0] {
            let mut draws = Draws::new(Purpose::Course, 1, 1);
            let mut counts = [0u32; 5];
            for _ in 0..20_000 {
                counts[shelf.draw(&mut draws, &mut Ranks::new(beta), (100, 0.0)).unwrap() as usize] += 1;
            }
            let weights: Vec<f64> =
                (1..=5).rev().map(|rank| libm::pow(f64::from(rank), -1.0 / beta)).collect();
            let all: f64 = weights.iter().sum();
            for (count, weight) in counts.iter().zip(&weights) {
                let p = weight / all;
                let sd = (p * (1.0 - p) / 20_000.0).sqrt();
                assert!((f64::from(*count) / 20_000.0 - p).abs() < 4.0 * sd, "β {beta}: {counts:?}");
            }
        }
    }

    #[test]
    fn the_stale_are_drawn_by_their_age() {
        let mut shelf = of(&[0.1, 0.2, 0.3]);
        for (seq, last) in [(0, 90), (1, 60), (2, 50)] {
            shelf.proposed(seq, last);
        }
        let mut draws = Draws::new(Purpose::Course, 1, 1);
        let mut counts = [0u32; 3];
        for _ in 0..20_000 {
            counts[shelf.draw(&mut draws, &mut Ranks::new(0.3), (100, 1.0)).unwrap() as usize] += 1;
        }
        for (count, p) in counts.iter().zip([0.1, 0.4, 0.5]) {
            assert!((f64::from(*count) / 20_000.0 - p).abs() < 0.015, "{counts:?}");
        }
        assert_eq!(Shelf::default().draw(&mut draws, &mut Ranks::new(0.3), (1, 1.0)), None);
    }
}
