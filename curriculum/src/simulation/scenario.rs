//! Scenarios that consist of their difficulty alone.

use env_core::KeyedRng;
use env_core::keyed_rng::RngPurpose;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::Proposal;

/// Share of fresh scenarios at level 0 that are contested. This and the next constant are near the measured values of
/// kessler/survival.
const CONTESTED_AT_ZERO: f64 = 0.3;
/// Rise of the share of contested scenarios with each row.
const CONTESTED_PER_ROW: f64 = 0.05;
/// Share of uncontested scenarios that are unsolvable, per row.
const UNSOLVABLE_PER_ROW: f64 = 0.02;
/// Standard deviation of the change of difficulty by an edit, in units of the learner's spread.
const EDIT_SPREAD: f64 = 0.4;

/// Scenario without a world, described by its difficulty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SyntheticScenario {
    /// Difficulty of its params, in rows of the task's level table.
    pub difficulty: f64,
    /// Difficulty beyond its params, in standard deviations of the spread that the learner sees.
    pub difficulty_offset: f64,
    /// True if acting well succeeds and doing nothing fails.
    pub contested: bool,
    /// True if success is possible.
    pub solvable: bool,
    /// Share of blind plans that succeed, 0 to 1.
    pub panel: f64,
}

/// Choice of one scenario among several by its predicted success; see [`crate::ScenarioSource::Chosen`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Selection {
    /// Number of scenarios to draw.
    pub among: u32,
    /// Logit of success where no blind plan succeeds.
    pub base: f64,
    /// Added to the logit in proportion to the share of blind plans that succeed.
    pub panel: f64,
}

impl Selection {
    /// Distance of a scenario's predicted success from one half.
    fn distance(&self, scenario: &SyntheticScenario) -> f64 {
        (1.0 / (1.0 + libm::exp(-(self.base + self.panel * scenario.panel))) - 0.5).abs()
    }
}

impl SyntheticScenario {
    /// Draws the scenario of a proposal of this difficulty, a function of seed and seq.
    #[must_use]
    pub fn draw(seed: u64, seq: u64, proposal: &Proposal, difficulty: f64) -> Self {
        let mut rng = KeyedRng::new(RngPurpose::Simulation, seed, seq);
        let contested =
            rng.bernoulli(CONTESTED_AT_ZERO + CONTESTED_PER_ROW * difficulty) || proposal.contested;
        let solvable = !rng.bernoulli(UNSOLVABLE_PER_ROW * difficulty) || contested;
        let panel = match (contested, solvable) {
            (true, _) => 0.5 * rng.uniform(),
            (false, true) => 0.5 + 0.5 * rng.uniform(),
            (false, false) => 0.0,
        };
        Self { difficulty, difficulty_offset: standard_normal(&mut rng), contested, solvable, panel }
    }

    /// The same scenario with a small change, a function of seed and seq.
    #[must_use]
    pub fn edit(self, seed: u64, seq: u64) -> Self {
        let mut rng = KeyedRng::new(RngPurpose::Simulation, seed, seq);
        let difficulty_offset = self.difficulty_offset + EDIT_SPREAD * standard_normal(&mut rng);
        // An edit may remove the threat that made the scenario contested, or add one.
        let contested = if rng.bernoulli(0.1) { !self.contested } else { self.contested };
        let panel = if contested { 0.5 * rng.uniform() } else { 0.5 + 0.5 * rng.uniform() };
        Self { difficulty_offset, contested, solvable: true, panel, ..self }
    }

    /// Draws several scenarios and returns the one whose predicted success is nearest one half.
    #[must_use]
    pub fn choose(seed: u64, seq: u64, proposal: &Proposal, difficulty: f64, selection: Selection) -> Self {
        let candidates = (0..selection.among)
            .map(|number| Self::draw(seed ^ (u64::from(number) + 1) << 32, seq, proposal, difficulty));
        let nearest = candidates.min_by(|a, b| selection.distance(a).total_cmp(&selection.distance(b)));
        nearest.unwrap_or_else(|| Self::draw(seed, seq, proposal, difficulty))
    }
}

/// Draws from the standard normal distribution by inversion.
fn standard_normal(rng: &mut KeyedRng) -> f64 {
    let uniform = rng.uniform().clamp(1e-12, 1.0 - 1e-12);
    Normal::standard().inverse_cdf(uniform)
}
