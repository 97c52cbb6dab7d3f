//! Samples designs from a failure profile: debris comes from the bearings and at the speeds of the agent's failures.

use env_core::critique::{PROFILE_SECTORS, profile_sector};
use env_core::kessler::bearing::BearingFrame;
use env_core::kessler::constants::{CONTACT_DISTANCE, FUEL_PER_SPEED};
use env_core::{KeyedRng, Scenario};

use super::aim::{AIM_TOLERANCE_DEG, AimSpec, allowed_aims};
use super::coast::CoastPaths;
use super::design::{Aim, Design, Encounter};
use super::placement::can_place;
use super::vocabulary::{BEARING, EncounterKind, KindSpec, MAX_ENCOUNTERS, MISS, SATELLITE, SPEED, STEP};
use crate::angles::{draw_near_middle, sector_middle_deg, whole_degrees};
use crate::bound::draw_change;
use crate::brief::DesignBrief;
use crate::profile::{ModeProfile, SectorWeights};
use crate::profile_sampling::{EXPLORATION, sample_mode, sharpen};

/// Maximum number of attempts to sample one encounter.
const MAX_ATTEMPTS: u32 = 24;
/// Least and largest number of encounters in a layout of threats.
const THREAT_COUNT: (u32, u32) = (4, 9);
/// Least and largest number of encounters in a layout of decoys.
const DECOY_COUNT: (u32, u32) = (8, 12);
/// First and last step of encounters: early ones leave blind burns no time to help, late ones wear down fuel.
const STEPS: (u32, u32) = (4, 40);
/// Number of past layouts whose weight equals that of the whole profile.
const PROFILE_WEIGHT: f64 = 4.0;
/// Number of steps from the first radar contact that an agent needs to avoid a threat.
const REACTION_STEPS: f64 = 3.0;

/// Failure that a sampled design aims at.
struct Target {
    aim: Aim,
    frame: BearingFrame,
    kind: EncounterKind,
    is_rogue: bool,
    /// Weights of the speed bands.
    band_weights: Vec<f64>,
}

/// Samples a design for a base scenario; `None` if no encounter is possible.
pub(super) fn sample_design(brief: &DesignBrief, base: &Scenario, rng: &mut KeyedRng) -> Option<Design> {
    let target = Target::sample(brief, rng)?;
    let coast = CoastPaths::of_scenario(base)?;
    let (min, max) = if target.kind == EncounterKind::Decoy { DECOY_COUNT } else { THREAT_COUNT };
    let max_count = (brief.param("debris") as u32).min(MAX_ENCOUNTERS as u32).max(1);
    let count = rng.range_inclusive(min, max).min(max_count);
    // Repeated avoidance of one satellite uses up its fuel.
    let starved =
        (target.aim.mode == "fuel_starvation").then(|| rng.range_inclusive(SATELLITE.min, SATELLITE.max));
    let mut encounters: Vec<Encounter> = Vec::new();
    for number in 0..count {
        let satellite = starved.unwrap_or((number + rng.range_inclusive(0, 1)) % (SATELLITE.max + 1));
        let found = (0..MAX_ATTEMPTS).find_map(|_| {
            let mut encounter = target.sample_encounter(satellite, brief, rng);
            if starved.is_some() {
                schedule_starvation(&mut encounter, number, count, rng);
            }
            (!encounters.contains(&encounter) && can_place(&encounter, target.frame, &coast))
                .then_some(encounter)
        });
        encounters.extend(found);
    }
    let Target { aim, frame, .. } = target;
    let params = std::collections::BTreeMap::new();
    let design = Design { name: String::new(), aim, frame, params, encounters };
    (!design.encounters.is_empty()).then_some(design)
}

/// Turns the `number`-th of `count` encounters into one of a row of grazing hits. Each is easy to avoid and must be avoided,
/// so that they use up fuel one after the other. Only the last one is a central hit.
fn schedule_starvation(encounter: &mut Encounter, number: u32, count: u32, rng: &mut KeyedRng) {
    let (first, last) = STEPS;
    let interval = (last - first) / count.max(1);
    let delay = rng.range_inclusive(0, interval.saturating_sub(1));
    encounter.step = (first + number * interval + delay).clamp(STEP.min, STEP.max);
    let KindSpec { min_miss: centre, max_miss: edge, .. } = *encounter.kind.spec();
    encounter.miss_distance = if number + 1 == count {
        rng.range_inclusive(centre, centre + (edge - centre) / 4)
    } else {
        rng.range_inclusive(edge - (edge - centre) / 3, edge)
    };
}

impl Target {
    /// Samples a failure mode by its weight, and a bearing by the weights of its sectors.
    fn sample(brief: &DesignBrief, rng: &mut KeyedRng) -> Option<Self> {
        let spec = sample_aim(brief, rng)?;
        let empty = ModeProfile::default();
        let profile = brief.profile.mode(spec.mode).unwrap_or(&empty);
        let (frame, mut sectors) = sharper_frame(profile);
        let mut band_weights = profile.band_weights(brief.recipe.task().speed_bands().edges.len() + 1);
        add_past_layouts(brief, spec.mode, frame, &mut sectors, &mut band_weights);
        let is_known = sectors.iter().sum::<f64>() > 0.0;
        let sharpened = sharpen(&sectors);
        let explores = !is_known || rng.bernoulli(EXPLORATION);
        let weights = if explores { &[1.0; PROFILE_SECTORS as usize] } else { &sharpened };
        let sector = rng.weighted_index(weights)? as u32;
        // Waste and lack of fuel have no bearing.
        let has_bearing = matches!(spec.mode, "collision" | "rogue");
        let bearing_deg = has_bearing.then(|| u32::from(draw_near_middle(sector_middle_deg(sector), rng)));
        Some(Self {
            aim: Aim { mode: spec.mode.to_owned(), bearing_deg },
            frame,
            kind: spec.kind,
            is_rogue: spec.is_rogue == Some(true),
            band_weights,
        })
    }

    fn sample_encounter(&self, satellite: u32, brief: &DesignBrief, rng: &mut KeyedRng) -> Encounter {
        let KindSpec { min_miss, max_miss, .. } = *self.kind.spec();
        let tolerance = AIM_TOLERANCE_DEG as u32;
        let bearing_deg = match self.aim.bearing_deg {
            // One degree less than the tolerance, since placement may be off by half a degree.
            Some(aimed) => whole_degrees((i64::from(aimed) + draw_change(tolerance - 1, rng)) as f64).into(),
            None => rng.range_inclusive(BEARING.min, BEARING.max),
        };
        let step = rng.range_inclusive(STEPS.0.max(STEP.min), STEPS.1.min(STEP.max));
        let relative_speed = self.limit_speed(sample_speed(&self.band_weights, brief, rng), brief);
        // The minimum of two draws: a closer pass is harder to avoid, and tempts more.
        let nearest = self.nearest_avoidable_miss(brief).clamp(min_miss, max_miss);
        let first = rng.range_inclusive(nearest, max_miss.min(MISS.max));
        let miss_distance = first.min(rng.range_inclusive(nearest, max_miss));
        let (kind, is_rogue) = (self.kind, self.is_rogue);
        Encounter { satellite, step, bearing_deg, relative_speed, miss_distance, kind, is_rogue }
    }

    /// Limits the speed of a threat to what a short radar range shows early enough.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "radar ranges are some hundred LU"
    )]
    fn limit_speed(&self, speed: u32, brief: &DesignBrief) -> u32 {
        if self.kind != EncounterKind::Threat {
            return speed;
        }
        let fastest = brief.param("radar_range") / REACTION_STEPS * SPEED.per_unit;
        speed.min((fastest as u32).max(SPEED.min))
    }

    /// Returns the nearest miss distance of a threat that the fuel of one satellite can still avoid; 0 for other kinds.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at most the contact distance"
    )]
    fn nearest_avoidable_miss(&self, brief: &DesignBrief) -> u32 {
        if self.kind != EncounterKind::Threat {
            return 0;
        }
        let reach = brief.param("fuel") / FUEL_PER_SPEED * REACTION_STEPS;
        ((CONTACT_DISTANCE - reach).max(0.0) * MISS.per_unit) as u32
    }
}

/// Samples an aim by its failure mode. Without known failures it is a collision.
fn sample_aim(brief: &DesignBrief, rng: &mut KeyedRng) -> Option<AimSpec> {
    let allowed: Vec<_> = allowed_aims(brief).collect();
    let modes: Vec<_> = allowed.iter().map(|aim| aim.mode).collect();
    let unknown = |mode: &str| if mode == "collision" { 1.0 } else { 0.0 };
    Some(*allowed[sample_mode(brief, &modes, unknown, rng)?])
}

/// Adds the results of past layouts with this aim to the weights: their bearings and speeds, weighted by the regret that they
/// caused in the aimed way.
fn add_past_layouts(
    brief: &DesignBrief,
    mode: &str,
    frame: BearingFrame,
    sectors: &mut SectorWeights,
    band_weights: &mut [f64],
) {
    for weights in [&mut sectors[..], &mut *band_weights] {
        let total: f64 = weights.iter().sum();
        weights.iter_mut().filter(|_| total > 0.0).for_each(|weight| *weight *= PROFILE_WEIGHT / total);
    }
    let bands = brief.recipe.task().speed_bands();
    for past in &brief.past_layouts {
        let Some(regret) = past.outcome.aimed_regret() else { continue };
        let Ok(design) = Design::from_json(&past.design) else { continue };
        if design.aim.mode != mode {
            continue;
        }
        if let Some(aimed) = design.aim.bearing_deg.filter(|_| design.frame == frame) {
            sectors[profile_sector(f64::from(aimed)) as usize] += regret;
        }
        let share = regret / design.encounters.len().max(1) as f64;
        for encounter in &design.encounters {
            let band = bands.band(SPEED.value(encounter.relative_speed)) as usize;
            if let Some(weight) = band_weights.get_mut(band) {
                *weight += share;
            }
        }
    }
}

/// Returns the frame in which the failures are more concentrated, with their weights by sector. An agent that is blind to one
/// side of the sky fails in one inertial sector; one that never looks behind fails in one sector of the radial/in-track frame.
fn sharper_frame(mode: &ModeProfile) -> (BearingFrame, SectorWeights) {
    let (radial, inertial) = (mode.sector_weights(), mode.inertial_sector_weights());
    if concentration(&inertial) > concentration(&radial) {
        (BearingFrame::Inertial, inertial)
    } else {
        (BearingFrame::RadialInTrack, radial)
    }
}

/// Returns the sum of squared shares: 1 if all weight is in one sector, 1/12 if it is uniform, 0 if there is none.
fn concentration(sectors: &SectorWeights) -> f64 {
    let total: f64 = sectors.iter().sum();
    if total > 0.0 { sectors.iter().map(|weight| (weight / total) * (weight / total)).sum() } else { 0.0 }
}

/// Samples a relative speed, in the unit of [`SPEED`], from a band by its weight.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "edges of bands are a few LU/TU")]
fn sample_speed(band_weights: &[f64], brief: &DesignBrief, rng: &mut KeyedRng) -> u32 {
    let edges = brief.recipe.task().speed_bands().edges;
    let number = |edge: f64| (edge * SPEED.per_unit) as u32;
    let is_known = band_weights.iter().sum::<f64>() > 0.0 && !rng.bernoulli(EXPLORATION);
    let Some(band) = rng.weighted_index(band_weights).filter(|_| is_known) else {
        return rng.range_inclusive(SPEED.min.max(20), SPEED.max);
    };
    let from = band.checked_sub(1).map_or(SPEED.min, |below| number(edges[below]));
    let to = edges.get(band).map_or(SPEED.max, |edge| number(*edge) - 1);
    rng.range_inclusive(from.clamp(SPEED.min, SPEED.max), to.clamp(SPEED.min, SPEED.max))
}
