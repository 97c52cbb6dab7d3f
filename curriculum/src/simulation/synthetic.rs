//! Scenarios that are nothing but how hard they are.

use env_core::Draws;
use env_core::draws::Purpose;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::Proposal;

/// The share of scenarios as they come that are contested: at level 0, and by how much it grows with each row. About what is
/// measured in survival.
const CONTESTED: (f64, f64) = (0.3, 0.05);
/// The share of the others that nobody can solve, per row.
const UNSOLVABLE: f64 = 0.02;
/// How much an edit changes how hard a scenario is, rows.
const EDITED: f64 = 0.4;

/// A scenario.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Synthetic {
    /// How hard its params are, in rows of the task's table.
    pub params: f64,
    /// How much harder it is than they say, in standard deviations of the learner's world.
    pub luck: f64,
    /// Whether who does nothing fails, and who acts well does not.
    pub contested: bool,
    /// Whether anybody could succeed.
    pub solvable: bool,
    /// The share of blind plans that succeed.
    pub panel: f64,
}

/// A standard normal draw.
fn normal(draws: &mut Draws) -> f64 {
    let uniform = draws.uniform().clamp(1e-12, 1.0 - 1e-12);
    Normal::standard().inverse_cdf(uniform)
}

impl Synthetic {
    /// The scenario of a proposal of this difficulty: a function of (seed, seq).
    #[must_use]
    pub fn drawn(seed: u64, seq: u64, proposal: &Proposal, params: f64) -> Self {
        let mut draws = Draws::new(Purpose::Synthetic, seed, seq);
        let (base, per_row) = CONTESTED;
        let contested = draws.chance(base + per_row * params) || proposal.contested;
        let solvable = !draws.chance(UNSOLVABLE * params) || contested;
        let panel = match (contested, solvable) {
            (true, _) => 0.5 * draws.uniform(),
            (false, true) => 0.5 + 0.5 * draws.uniform(),
            (false, false) => 0.0,
        };
        Self { params, luck: normal(&mut draws), contested, solvable, panel }
    }

    /// The same with a little changed.
    #[must_use]
    pub fn edited(self, seed: u64, seq: u64) -> Self {
        let mut draws = Draws::new(Purpose::Synthetic, seed, seq);
        let luck = self.luck + EDITED * normal(&mut draws);
        // An edit may take away what mattered, or bring it in.
        let contested = if draws.chance(0.1) { !self.contested } else { self.contested };
        let panel = if contested { 0.5 * draws.uniform() } else { 0.5 + 0.5 * draws.uniform() };
        Self { luck, contested, solvable: true, panel, ..self }
    }

    /// The one of some that are drawn that a strategy would choose, by the share of blind plans that succeed.
    #[must_use]
    pub fn chosen(
        seed: u64,
        seq: u64,
        proposal: &Proposal,
        params: f64,
        (among, base, panel): (u32, f64, f64),
    ) -> Self {
        let off = |one: &Self| (1.0 / (1.0 + libm::exp(-(base + panel * one.panel))) - 0.5).abs();
        let all =
            (0..among).map(|number| Self::drawn(seed ^ (u64::from(number) + 1) << 32, seq, proposal, params));
        let best = all.min_by(|a, b| off(a).total_cmp(&off(b)));
        best.unwrap_or_else(|| Self::drawn(seed, seq, proposal, params))
    }
}
