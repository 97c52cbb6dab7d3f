//! The scenarios of a task that are worth repeating, in the order of their priority.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use env_core::KeyedRng;
use serde::{Deserialize, Serialize};

use crate::core::probabilities::LevelWeight;

/// Factor that each visit without a gain applies to a priority.
const DECAY: f64 = 0.7;
/// Number of visits from which a scenario without a gain decays.
const PATIENCE: u32 = 3;
/// Smallest rise of the mean score over the best so far that is a gain: a hundredth of the scores' range.
const MIN_GAIN: f64 = 0.01;

/// Scenario in the buffer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct BufferedLevel {
    /// Level at which the scenario, or its ancestor if it was edited, was drawn.
    pub(super) level: Option<u32>,
    /// Number of outcomes observed.
    pub(super) visits: u32,
    /// Mean over the visits of the scenario's teaching value.
    pub(super) score: f64,
    /// Best mean score of a visit.
    best: f64,
    /// Number of visits since the best one.
    stalled: u32,
    /// Number of edits between this scenario and a fresh one.
    pub(super) generation: u32,
}

impl BufferedLevel {
    /// A scenario after its first visit.
    pub(super) const fn new(level: Option<u32>, visit: Visit, generation: u32) -> Self {
        Self { level, visits: 1, score: visit.score, best: visit.mean_score, stalled: 0, generation }
    }

    /// Priority of another visit: the score, decayed for a scenario that was visited often without a gain. A reference
    /// with hindsight leaves gaps that no agent can close, so such scenarios must be evicted.
    pub(super) fn priority(&self) -> f64 {
        let decays = if self.visits >= PATIENCE { self.stalled.saturating_sub(PATIENCE - 1) } else { 0 };
        self.score * DECAY.powi(i32::try_from(decays.min(64)).unwrap_or(64))
    }

    fn record(&mut self, visit: Visit) {
        self.visits = self.visits.saturating_add(1);
        self.score += (visit.score - self.score) / f64::from(self.visits);
        if visit.mean_score > self.best + MIN_GAIN {
            (self.best, self.stalled) = (visit.mean_score, 0);
        } else {
            self.stalled = self.stalled.saturating_add(1);
        }
    }
}

/// Result of one visit of a scenario.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Visit {
    /// Teaching value of the scenario, by the measure that the settings select.
    pub(super) score: f64,
    /// Mean score of the episodes.
    pub(super) mean_score: f64,
}

/// Level buffer of a task.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "StoredBuffer", into = "StoredBuffer")]
pub(super) struct LevelBuffer {
    /// Scenarios by the seq of the proposal that made them.
    levels: BTreeMap<u64, BufferedLevel>,
    /// Sort keys of all scenarios, in order.
    ranking: Vec<RankKey>,
    /// Latest proposals of all scenarios, sorted by seq.
    last_proposals: Vec<LastProposal>,
    /// Sum of all `last_proposals`' `last`.
    sum_of_last: u128,
}

/// Sort key of a scenario: the highest priority first, the newer scenario first among equals.
#[derive(Debug, Clone, Copy, PartialEq)]
struct RankKey {
    priority: f64,
    seq: u64,
}

impl RankKey {
    fn order(&self, other: &Self) -> Ordering {
        other.priority.total_cmp(&self.priority).then(other.seq.cmp(&self.seq))
    }
}

/// Seq at which a scenario was proposed last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct LastProposal {
    /// Seq of the proposal that made the scenario.
    seq: u64,
    /// Seq of its latest proposal.
    last: u64,
}

impl LevelBuffer {
    pub(super) const fn len(&self) -> usize {
        self.ranking.len()
    }

    /// The scenario that the proposal `seq` made, if it is kept.
    pub(super) fn get(&self, seq: u64) -> Option<&BufferedLevel> {
        self.levels.get(&seq)
    }

    /// All scenarios with the seq of the proposal that made them, the highest priority first.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u64, &BufferedLevel)> {
        self.ranking.iter().filter_map(|key| Some((key.seq, self.levels.get(&key.seq)?)))
    }

    /// Keeps a scenario after its first visit if it has anything to teach and is among the best `capacity`.
    pub(super) fn insert(&mut self, seq: u64, level: BufferedLevel, capacity: usize) {
        if level.score > 0.0 && !self.levels.contains_key(&seq) {
            self.put(seq, seq, level);
            self.shrink(capacity);
        }
    }

    /// Records another visit of a scenario; false if the scenario is not in the buffer.
    pub(super) fn record_visit(&mut self, seq: u64, visit: Visit) -> bool {
        let Some(level) = self.levels.get_mut(&seq) else { return false };
        let old = RankKey { priority: level.priority(), seq };
        level.record(visit);
        let new = RankKey { priority: level.priority(), seq };
        if let Ok(at) = self.ranking.binary_search_by(|key| key.order(&old)) {
            self.ranking.remove(at);
        }
        self.rank(new);
        true
    }

    /// Notes that a scenario was proposed again at the event `now`.
    pub(super) fn set_last_proposed(&mut self, seq: u64, now: u64) {
        if let Ok(at) = self.find_last_proposal(seq) {
            let proposal = &mut self.last_proposals[at];
            self.sum_of_last = self.sum_of_last - u128::from(proposal.last) + u128::from(now);
            proposal.last = now;
        }
    }

    /// Drops the scenarios of lowest priority until at most `capacity` are left.
    pub(super) fn shrink(&mut self, capacity: usize) {
        for key in self.ranking.split_off(capacity.min(self.ranking.len())) {
            self.levels.remove(&key.seq);
            if let Ok(at) = self.find_last_proposal(key.seq) {
                self.sum_of_last -= u128::from(self.last_proposals.remove(at).last);
            }
        }
    }

    /// Samples a scenario by the rank of its priority (Jiang et al. 2021, equation 2). Returns its seq; `None` if the
    /// buffer is empty.
    pub(super) fn sample_by_rank(&self, rng: &mut KeyedRng, weights: &mut RankWeights) -> Option<u64> {
        self.ranking.get(weights.pick(self.ranking.len(), rng.uniform())).map(|key| key.seq)
    }

    /// Samples a scenario by its staleness, the number of events since its latest proposal (Jiang et al. 2021, equation
    /// 3). Returns its seq; `None` if the buffer is empty.
    pub(super) fn sample_by_staleness(&self, rng: &mut KeyedRng, now: u64) -> Option<u64> {
        let total = (u128::from(now) * self.last_proposals.len() as u128).saturating_sub(self.sum_of_last);
        let mut left = rng.uniform() * total as f64;
        let found = self.last_proposals.iter().find(|proposal| {
            left -= now.saturating_sub(proposal.last) as f64;
            left < 0.0
        });
        found.or(self.last_proposals.first()).map(|proposal| proposal.seq)
    }

    /// Levels of all scenarios, with their weights in [`Self::sample_by_rank`].
    pub(super) fn levels_by_rank<'a>(
        &'a self,
        weights: &'a RankWeights,
    ) -> impl Iterator<Item = LevelWeight> + 'a {
        let ranked = self.iter().enumerate();
        ranked.filter_map(|(rank, (_, scenario))| {
            Some(LevelWeight { level: scenario.level?, weight: weights.weight(rank) })
        })
    }

    /// Levels of all scenarios, with their weights in [`Self::sample_by_staleness`] at the event `now`.
    pub(super) fn levels_by_staleness(&self, now: u64) -> impl Iterator<Item = LevelWeight> {
        self.last_proposals.iter().filter_map(move |proposal| {
            let level = self.levels.get(&proposal.seq)?.level?;
            Some(LevelWeight { level, weight: now.saturating_sub(proposal.last) as f64 })
        })
    }

    fn put(&mut self, seq: u64, last: u64, level: BufferedLevel) {
        if self.levels.insert(seq, level).is_none() {
            self.rank(RankKey { priority: level.priority(), seq });
            if let Err(at) = self.find_last_proposal(seq) {
                self.last_proposals.insert(at, LastProposal { seq, last });
                self.sum_of_last += u128::from(last);
            }
        }
    }

    fn rank(&mut self, key: RankKey) {
        if let Err(at) = self.ranking.binary_search_by(|other| other.order(&key)) {
            self.ranking.insert(at, key);
        }
    }

    fn find_last_proposal(&self, seq: u64) -> Result<usize, usize> {
        self.last_proposals.binary_search_by_key(&seq, |proposal| proposal.seq)
    }
}

/// Stored form of a buffer: its scenarios in the order of their seq; the rest follows from them.
#[derive(Clone, Serialize, Deserialize)]
struct StoredBuffer(Vec<StoredLevel>);

/// Stored form of a scenario: the seq of the proposal that made it, the seq of its latest proposal, and the scenario.
#[derive(Clone, Serialize, Deserialize)]
struct StoredLevel(u64, u64, BufferedLevel);

impl From<StoredBuffer> for LevelBuffer {
    fn from(StoredBuffer(stored): StoredBuffer) -> Self {
        let mut buffer = Self::default();
        for StoredLevel(seq, last, level) in stored {
            buffer.put(seq, last, level);
        }
        buffer
    }
}

impl From<LevelBuffer> for StoredBuffer {
    fn from(buffer: LevelBuffer) -> Self {
        let stored = |(&seq, &level): (&u64, &BufferedLevel)| {
            let last = buffer.find_last_proposal(seq).map_or(seq, |at| buffer.last_proposals[at].last);
            StoredLevel(seq, last, level)
        };
        Self(buffer.levels.iter().map(stored).collect())
    }
}

/// Cumulative weights of the ranks, (1/rank)^(1/β). They depend on β alone and are computed as the buffer grows.
#[derive(Debug, Clone, Default)]
pub(super) struct RankWeights {
    power: f64,
    cumulative: Vec<f64>,
}

impl RankWeights {
    pub(super) const fn new(beta: f64) -> Self {
        Self { power: -1.0 / beta, cumulative: Vec::new() }
    }

    /// Weight of a rank, counted from 0.
    fn weight(&self, rank: usize) -> f64 {
        libm::pow(rank as f64 + 1.0, self.power)
    }

    /// Index among `len` ranks at which `draw`, a number in [0, 1), falls.
    fn pick(&mut self, len: usize, draw: f64) -> usize {
        while self.cumulative.len() < len {
            let before = self.cumulative.last().copied().unwrap_or(0.0);
            self.cumulative.push(before + self.weight(self.cumulative.len()));
        }
        let sums = &self.cumulative[..len];
        let target = draw * sums.last().copied().unwrap_or(0.0);
        sums.partition_point(|sum| *sum <= target).min(len.saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use env_core::keyed_rng::RngPurpose;

    use super::*;

    fn visit(score: f64, mean_score: f64) -> Visit {
        Visit { score, mean_score }
    }

    fn level(score: f64) -> BufferedLevel {
        BufferedLevel::new(None, visit(score, 0.0), 0)
    }

    /// A buffer whose scenarios 0, 1, … have these scores.
    fn buffer(scores: &[f64]) -> LevelBuffer {
        let mut buffer = LevelBuffer::default();
        for (seq, score) in (0..).zip(scores) {
            buffer.insert(seq, level(*score), 100);
        }
        buffer
    }

    fn order(buffer: &LevelBuffer) -> Vec<u64> {
        buffer.iter().map(|(seq, _)| seq).collect()
    }

    fn test_rng() -> KeyedRng {
        KeyedRng::new(RngPurpose::Curriculum, 1, 1)
    }

    #[test]
    fn highest_scores_rank_first_and_lowest_are_dropped() {
        let mut buffer = buffer(&[0.2, 0.9, 0.0, 0.5, 0.9]);
        assert_eq!(order(&buffer), [4, 1, 3, 0], "a score of 0 is not kept; the newer is first among equals");
        buffer.shrink(3);
        assert_eq!(order(&buffer), [4, 1, 3]);
        buffer.insert(9, level(0.1), 3);
        assert_eq!(order(&buffer), [4, 1, 3], "its score is below all that are kept");
        assert!(buffer.get(9).is_none());
    }

    #[test]
    fn score_is_the_mean_over_visits() {
        let mut buffer = buffer(&[0.9, 0.6]);
        assert!(buffer.record_visit(0, visit(0.1, 0.5)));
        assert!((buffer.get(0).unwrap().score - 0.5).abs() < 1e-12);
        assert_eq!(order(&buffer), [1, 0]);
        assert!(!buffer.record_visit(77, visit(0.5, 0.5)));
    }

    #[test]
    fn priority_decays_without_gains_only() {
        let mut buffer = buffer(&[0.8, 0.8]);
        for round in 1..10 {
            buffer.record_visit(0, visit(0.8, 0.0));
            buffer.record_visit(1, visit(0.8, 0.05 * f64::from(round)));
        }
        assert!((buffer.get(1).unwrap().priority() - 0.8).abs() < 1e-12);
        let decayed = buffer.get(0).unwrap().priority();
        assert!((decayed - 0.8 * 0.7f64.powi(7)).abs() < 1e-12, "{decayed}");
        assert_eq!(order(&buffer), [1, 0]);
    }

    #[test]
    fn buffer_round_trips_through_json() {
        let mut buffer = buffer(&[0.3, 0.8, 0.8, 0.1]);
        buffer.set_last_proposed(2, 40);
        buffer.record_visit(1, visit(0.1, 0.4));
        let back: LevelBuffer = serde_json::from_value(serde_json::to_value(&buffer).unwrap()).unwrap();
        assert_eq!(back, buffer);
    }

    /// Compares the shares of 20 000 draws with (1/rank)^(1/β), within four standard deviations.
    #[test]
    fn ranks_are_sampled_by_their_weights() {
        let buffer = buffer(&[0.1, 0.2, 0.3, 0.4, 0.5]);
        for beta in [0.3, 1.0] {
            let mut rng = test_rng();
            let mut counts = [0u32; 5];
            for _ in 0..20_000 {
                let seq = buffer.sample_by_rank(&mut rng, &mut RankWeights::new(beta)).unwrap();
                counts[seq as usize] += 1;
            }
            let weights: Vec<f64> =
                (1..=5).rev().map(|rank| libm::pow(f64::from(rank), -1.0 / beta)).collect();
            let total: f64 = weights.iter().sum();
            for (count, weight) in counts.iter().zip(&weights) {
                let p = weight / total;
                let sd = (p * (1.0 - p) / 20_000.0).sqrt();
                assert!((f64::from(*count) / 20_000.0 - p).abs() < 4.0 * sd, "β {beta}: {counts:?}");
            }
        }
    }

    #[test]
    fn stale_scenarios_are_sampled_by_their_age() {
        let mut buffer = buffer(&[0.1, 0.2, 0.3]);
        for (seq, last) in [(0, 90), (1, 60), (2, 50)] {
            buffer.set_last_proposed(seq, last);
        }
        let mut rng = test_rng();
        let mut counts = [0u32; 3];
        for _ in 0..20_000 {
            counts[buffer.sample_by_staleness(&mut rng, 100).unwrap() as usize] += 1;
        }
        for (count, p) in counts.iter().zip([0.1, 0.4, 0.5]) {
            assert!((f64::from(*count) / 20_000.0 - p).abs() < 0.015, "{counts:?}");
        }
        assert_eq!(LevelBuffer::default().sample_by_staleness(&mut rng, 1), None);
    }
}
