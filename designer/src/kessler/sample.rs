//! New designs from a failure profile: debris comes from where, and as fast as, what took the agent came.

use env_core::critique::{SECTORS, sector};
use env_core::kessler::bearing::Frame;
use env_core::kessler::constants::{CONTACT_DISTANCE, FUEL_PER_SPEED};
use env_core::{Draws, Scenario};

use super::Kind;
use super::claim::AIM_WIDTH;
use super::language::{Aim, BEARING, Design, Encounter, MAX_ENCOUNTERS, MISS, SATELLITE, SPEED, STEP};
use super::sky::Sky;
use super::speak::aims;
use crate::brief::Brief;
use crate::profile::{ModeProfile, Rose};

/// The share of designs that look where nothing was found yet.
const EXPLORED: f64 = 0.05;
/// Tries at one encounter.
const TRIES: u32 = 24;
/// Threats of a design, and decoys of one that is all decoys.
const THREATS: (u32, u32) = (4, 9);
const DECOYS: (u32, u32) = (8, 12);
/// Steps at which encounters are put: early ones leave blind kicks no time, late ones wear down fuel.
const STEPS: (u32, u32) = (4, 40);

/// What a design goes for.
pub(super) struct Target {
    pub(super) aim: Aim,
    pub(super) frame: Frame,
    kind: Kind,
    rogue: bool,
    /// Weights of the speed bands.
    speeds: Vec<f64>,
    /// Where decoys of this design come from: everywhere where the aim has no bearing.
    bearing: Option<u32>,
}

/// A design for this sky.
pub(super) fn sample(brief: &Brief, sky: &Scenario, draws: &mut Draws) -> Option<Design> {
    let target = target(brief, draws)?;
    let sky = Sky::of(sky)?;
    let bounds = if target.kind == Kind::Decoy { DECOYS } else { THREATS };
    let room = (brief.param("debris") as u32).min(MAX_ENCOUNTERS as u32).max(1);
    let wanted = draws.between(bounds.0, bounds.1).min(room);
    // Starved of fuel is who must dodge again and again: all go for one satellite.
    let one = (target.aim.mode == "fuel_starvation").then(|| draws.between(SATELLITE.min, SATELLITE.max));
    let mut encounters: Vec<Encounter> = Vec::new();
    for number in 0..wanted {
        let satellite = one.unwrap_or((number + draws.between(0, 1)) % (SATELLITE.max + 1));
        let found = (0..TRIES).find_map(|_| {
            let mut encounter = target.encounter(satellite, brief, draws);
            if one.is_some() {
                wear_down(&mut encounter, number, wanted, draws);
            }
            (!encounters.contains(&encounter) && sky.takes(&encounter, target.frame)).then_some(encounter)
        });
        encounters.extend(found);
    }
    let Target { aim, frame, .. } = target;
    let design =
        Design { name: String::new(), aim, frame, params: std::collections::BTreeMap::new(), encounters };
    (!design.encounters.is_empty()).then_some(design)
}

/// The `number`-th of a row of threats that take fuel and, but for the last, little else: hits at the rim, which any dodge
/// evades and which must be dodged, one after the other.
fn wear_down(encounter: &mut Encounter, number: u32, of: u32, draws: &mut Draws) {
    let (first, last) = STEPS;
    let every = (last - first) / of.max(1);
    encounter.step =
        (first + number * every + draws.between(0, every.saturating_sub(1))).clamp(STEP.min, STEP.max);
    let (_, _, centre, rim, _) = *encounter.kind.row();
    encounter.miss_distance = if number + 1 == of {
        draws.between(centre, centre + (rim - centre) / 4)
    } else {
        draws.between(rim - (rim - centre) / 3, rim)
    };
}

/// What to go for: a mode by its weight, and where it hurts most.
fn target(brief: &Brief, draws: &mut Draws) -> Option<Target> {
    let known: Vec<_> = aims(brief).collect();
    let blank = ModeProfile::default();
    let weight = |name: &str| brief.profile.mode(name).map_or(0.0, |mode| mode.weight);
    // Squared: what stands out gets most.
    let mut weights: Vec<f64> = known.iter().map(|aim| weight(aim.0) * weight(aim.0)).collect();
    if weights.iter().all(|weight| *weight <= 0.0) {
        weights = known.iter().map(|aim| if aim.0 == "collision" { 1.0 } else { 0.0 }).collect();
    }
    let (mode, kind, rogue, _) = *known[draws.weighted(&weights)?];
    let profile = brief.profile.mode(mode).unwrap_or(&blank);
    let (frame, mut rose) = sharper(profile);
    let mut speeds = profile.speeds(brief.base.task().speed_bands().edges.len() + 1);
    learn(brief, mode, frame, &mut rose, &mut speeds);
    let met = rose.iter().sum::<f64>() > 0.0;
    let sharpened = sharpened(&rose);
    let explores = !met || draws.chance(EXPLORED);
    let sector = draws.weighted(if explores { &[1.0; SECTORS as usize] } else { &sharpened })?;
    let centre = sector as f64 * 360.0 / f64::from(SECTORS);
    // Fuel is wasted and runs out from wherever it comes.
    let aimed = matches!(mode, "collision" | "rogue");
    let bearing = aimed.then(|| turned(centre, f64::from(draws.between(0, 20)) - 10.0));
    Some(Target {
        aim: Aim { mode: mode.to_owned(), bearing_deg: bearing },
        frame,
        kind,
        rogue: rogue == Some(true),
        speeds,
        bearing,
    })
}

/// Layouts that what the profile says weighs as much as.
const PRIOR: f64 = 4.0;

/// Adds what earlier layouts for this mode have shown: where they came from and how fast, by how much the agent left on the
/// table there in the way that was aimed at.
fn learn(brief: &Brief, mode: &str, frame: Frame, rose: &mut Rose, speeds: &mut [f64]) {
    for weights in [&mut rose[..], &mut *speeds] {
        let all: f64 = weights.iter().sum();
        weights.iter_mut().filter(|_| all > 0.0).for_each(|weight| *weight *= PRIOR / all);
    }
    let bands = brief.base.task().speed_bands();
    for past in &brief.fates {
        let Some(worth) = past.fate.worth() else { continue };
        let Ok(design) = Design::from_json(&past.design) else { continue };
        if design.aim.mode != mode {
            continue;
        }
        if let Some(aimed) = design.aim.bearing_deg.filter(|_| design.frame == frame) {
            rose[sector(f64::from(aimed)) as usize] += worth;
        }
        let share = worth / design.encounters.len().max(1) as f64;
        for encounter in &design.encounters {
            if let Some(weight) = speeds.get_mut(bands.band(SPEED.value(encounter.relative_speed)) as usize) {
                *weight += share;
            }
        }
    }
}

/// The frame in which the failures stand closer together, and their rose there: an agent that is blind to one side of the
/// sky fails all around its orbit, one that never looks behind fails all around the sky.
pub(super) fn sharper(mode: &ModeProfile) -> (Frame, Rose) {
    let (orbit, inertial) = (mode.rose(), mode.inertial_rose());
    if focus(&inertial) > focus(&orbit) { (Frame::Inertial, inertial) } else { (Frame::RadialInTrack, orbit) }
}

/// The sum of squared shares: 1 where all is in one sector, 1/12 where it is spread evenly, 0 of nothing.
fn focus(rose: &Rose) -> f64 {
    let all: f64 = rose.iter().sum();
    if all > 0.0 { rose.iter().map(|weight| (weight / all) * (weight / all)).sum() } else { 0.0 }
}

/// A rose from which draws go to the middle of what stands out: each sector with half of its neighbours, cubed.
fn sharpened(rose: &Rose) -> Rose {
    let last = rose.len() - 1;
    let mut sharp = *rose;
    for (at, weight) in sharp.iter_mut().enumerate() {
        let beside = rose[if at == 0 { last } else { at - 1 }] + rose[if at == last { 0 } else { at + 1 }];
        let smooth = rose[at] + 0.5 * beside;
        *weight = smooth * smooth * smooth;
    }
    sharp
}

/// A bearing, some degrees on.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number from 0 to 359")]
pub(super) fn turned(bearing_deg: f64, by: f64) -> u32 {
    let turned = libm::round(bearing_deg + by);
    let wrapped = turned - libm::floor(turned / 360.0) * 360.0;
    (wrapped as u32).min(BEARING.max)
}

impl Target {
    fn encounter(&self, satellite: u32, brief: &Brief, draws: &mut Draws) -> Encounter {
        let (_, _, min, max, _) = *self.kind.row();
        let width = AIM_WIDTH as u32;
        let bearing_deg = match self.bearing {
            // Half a degree of the aim's width is the compiler's.
            Some(aimed) => {
                turned(f64::from(aimed), f64::from(draws.between(0, 2 * width - 2)) - f64::from(width - 1))
            }
            None => draws.between(BEARING.min, BEARING.max),
        };
        Encounter {
            satellite,
            step: draws.between(STEPS.0.max(STEP.min), STEPS.1.min(STEP.max)),
            bearing_deg,
            relative_speed: self.dodgeable(speed(&self.speeds, brief, draws), brief),
            // The nearer, the more it takes to dodge, and the more it tempts.
            miss_distance: {
                let min = self.rim(brief).clamp(min, max);
                draws.between(min, max.min(MISS.max)).min(draws.between(min, max))
            },
            kind: self.kind,
            rogue: self.rogue,
        }
    }
}

/// Steps that whoever dodges has from when the radar shows it.
const NOTICE: f64 = 3.0;

impl Target {
    /// The speed, or the fastest at which a short radar shows a threat in time.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a radar sees some hundred LU"
    )]
    fn dodgeable(&self, speed: u32, brief: &Brief) -> u32 {
        if self.kind != Kind::Threat {
            return speed;
        }
        let fastest = brief.param("radar_range") / NOTICE / SPEED.scale;
        speed.min((fastest as u32).max(SPEED.min))
    }

    /// The nearest miss that the fuel of one satellite still dodges, in the language's whole numbers.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "within the size of a contact"
    )]
    fn rim(&self, brief: &Brief) -> u32 {
        if self.kind != Kind::Threat {
            return 0;
        }
        let reach = brief.param("fuel") / FUEL_PER_SPEED * NOTICE;
        ((CONTACT_DISTANCE - reach).max(0.0) / MISS.scale) as u32
    }
}

/// A speed of a band that the failures are in, in the language's whole numbers.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "edges of bands are a few LU/TU")]
fn speed(weights: &[f64], brief: &Brief, draws: &mut Draws) -> u32 {
    let edges = brief.base.task().speed_bands().edges;
    let number = |edge: f64| (edge / SPEED.scale) as u32;
    let known = weights.iter().sum::<f64>() > 0.0 && !draws.chance(EXPLORED);
    let Some(band) = draws.weighted(weights).filter(|_| known) else {
        return draws.between(SPEED.min.max(20), SPEED.max);
    };
    let from = band.checked_sub(1).map_or(SPEED.min, |below| number(edges[below]));
    let to = edges.get(band).map_or(SPEED.max, |edge| number(*edge) - 1);
    draws.between(from.clamp(SPEED.min, SPEED.max), to.clamp(SPEED.min, SPEED.max))
}
