//! Draws from a failure profile that the samplers of all worlds share.

use env_core::KeyedRng;

use crate::angles::{draw_near_middle, sector_middle_deg};
use crate::brief::DesignBrief;
use crate::profile::SectorWeights;

/// Share of designs that ignore the profile, to explore places and speeds without known failures.
pub(crate) const EXPLORATION: f64 = 0.05;

/// Samples the index of a failure mode by its squared weight in the profile, so that frequent failures dominate. Without known
/// failures, `unknown` gives the weight of each mode. `None` if there is no mode.
pub(crate) fn sample_mode(
    brief: &DesignBrief,
    modes: &[&str],
    unknown: impl Fn(&str) -> f64,
    rng: &mut KeyedRng,
) -> Option<usize> {
    let weight = |mode: &str| brief.profile.mode(mode).map_or(0.0, |profile| profile.weight);
    let mut weights: Vec<f64> = modes.iter().map(|mode| weight(mode) * weight(mode)).collect();
    if weights.iter().all(|weight| *weight <= 0.0) {
        weights = modes.iter().map(|mode| unknown(mode)).collect();
    }
    rng.weighted_index(&weights)
}

/// Returns weights that favour the middle of peaks: each sector plus half of its neighbours, cubed.
pub(crate) fn sharpen(sectors: &SectorWeights) -> SectorWeights {
    let last = sectors.len() - 1;
    let mut sharpened = *sectors;
    for (index, weight) in sharpened.iter_mut().enumerate() {
        let left = sectors[if index == 0 { last } else { index - 1 }];
        let right = sectors[if index == last { 0 } else { index + 1 }];
        let smooth = sectors[index] + 0.5 * (left + right);
        *weight = smooth * smooth * smooth;
    }
    sharpened
}

/// Samples an angle near the middle of a sector by its sharpened weight, in whole degrees; `None` if there are no known failures, and sometimes in
/// order to explore.
pub(crate) fn sample_sector_deg(sectors: &SectorWeights, rng: &mut KeyedRng) -> Option<u16> {
    let is_known = sectors.iter().sum::<f64>() > 0.0;
    if !is_known || rng.bernoulli(EXPLORATION) {
        return None;
    }
    let sector = rng.weighted_index(&sharpen(sectors))? as u32;
    Some(draw_near_middle(sector_middle_deg(sector), rng))
}
