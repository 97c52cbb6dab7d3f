//! Samples designs from a failure profile: starts and fields in which the agent's failures are likely, at the orbit angles of its failures.

use env_core::critique::profile_sector;
use env_core::{KeyedRng, Scenario};

use super::aim::allowed_aims;
use super::build::build_design;
use super::design::TaskingDesign;
use super::sample_parts::{Draft, sample_start};
use crate::brief::DesignBrief;
use crate::profile::SectorWeights;
use crate::profile_sampling::{sample_mode, sample_sector_deg};

/// Maximum number of attempts to sample a design that matches its aim.
const MAX_ATTEMPTS: u32 = 16;
/// Number of past layouts whose weight equals that of the whole profile.
const PROFILE_WEIGHT: f64 = 4.0;

/// Samples a design for a base scenario; `None` if no attempt matches its aim.
pub(super) fn sample_design(
    brief: &DesignBrief,
    base: &Scenario,
    rng: &mut KeyedRng,
) -> Option<TaskingDesign> {
    let modes: Vec<_> = allowed_aims(brief).map(|aim| aim.mode).collect();
    let mode = modes[sample_mode(brief, &modes, |_| 1.0, rng)?];
    let aim_angle_deg = sample_angle(brief, mode, rng);
    (0..MAX_ATTEMPTS).find_map(|_| {
        let start = sample_start(rng);
        let draft = Draft::new(mode, aim_angle_deg, start, base);
        draft.complete(rng).filter(|design| build_design(design, base).is_ok())
    })
}

/// Samples the orbit angle of an aim by the weight of its sector; `None` if no failure has one. The place of a power failure
/// follows from the shadow.
fn sample_angle(brief: &DesignBrief, mode: &str, rng: &mut KeyedRng) -> Option<i32> {
    if mode == "power" {
        return None;
    }
    let mut sectors = brief.profile.mode(mode).map_or_else(SectorWeights::default, |m| m.sector_weights());
    add_past_layouts(brief, mode, &mut sectors);
    sample_sector_deg(&sectors, rng).map(i32::from)
}

/// Adds the results of past layouts with this aim to the weights, by the regret that they caused in the aimed way.
fn add_past_layouts(brief: &DesignBrief, mode: &str, sectors: &mut SectorWeights) {
    let total: f64 = sectors.iter().sum();
    sectors.iter_mut().filter(|_| total > 0.0).for_each(|weight| *weight *= PROFILE_WEIGHT / total);
    for past in &brief.past_layouts {
        let Some(regret) = past.outcome.aimed_regret() else { continue };
        let Ok(design) = TaskingDesign::from_json(&past.design) else { continue };
        if let Some(angle) = design.aim_angle_deg.filter(|_| design.mode == mode) {
            sectors[profile_sector(f64::from(angle)) as usize] += regret;
        }
    }
}
