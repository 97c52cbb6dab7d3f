//! Samples designs from a failure profile: the first deputy makes the aimed failure likely, by inverting the condition of its
//! aim; the others repeat it or keep it company.

use std::collections::BTreeMap;

use env_core::docking::constants::{DOCKING_RADIUS_M, DOCKING_SPEED_M_S, LIMIT_SLOPE_1_S, MASS_KG};
use env_core::docking::relative_motion::speed_limit;
use env_core::{KeyedRng, Scenario};

use super::aim::{DeputyCounts, allowed_aims};
use super::approach::{distance_at_limit, excess_for_penalty, step_out_of_bounds};
use super::checks::is_playable;
use super::design::{DeputyStart, DockingAim, DockingDesign};
use super::formation::{Formation, scatter};
use super::vocabulary::{BEARING, CLOSING, CROSS, DISTANCE, effective_choices};
use crate::angles::whole_degrees;
use crate::brief::DesignBrief;
use crate::profile::ModeProfile;
use crate::profile_sampling::{EXPLORATION, sample_mode, sample_sector_deg};

/// Maximum number of attempts to sample a design.
const MAX_ATTEMPTS: u32 = 24;
/// Chance that another deputy repeats the aimed failure.
const REPEAT_CHANCE: f64 = 0.5;
/// Share of the time limit that an ordinary deputy needs at most.
const ORDINARY_TIME_SHARE: f64 = 0.7;

/// Samples a design for a base scenario; `None` if no attempt succeeds.
pub(super) fn sample_design(
    brief: &DesignBrief,
    base: &Scenario,
    rng: &mut KeyedRng,
) -> Option<DockingDesign> {
    let modes: Vec<&'static str> = allowed_aims(brief).map(|aim| aim.mode).collect();
    let mode = modes[sample_mode(brief, &modes, |_| 1.0, rng)?];
    (0..MAX_ATTEMPTS).find_map(|_| {
        let design = Sampler::new(mode, brief, rng).design(rng)?;
        is_playable(&design, base).then_some(design)
    })
}

/// Numbers that deputies of one design depend on.
struct Sampler<'a> {
    mode: &'static str,
    brief: &'a DesignBrief,
    params: BTreeMap<String, f64>,
    /// Time limit of the episode, s.
    time_limit: f64,
    /// Acceleration by full thrust on one axis, m/s².
    acceleration: f64,
}

impl<'a> Sampler<'a> {
    /// Chooses the params of a design: those that the mode needs, and sometimes another one.
    fn new(mode: &'static str, brief: &'a DesignBrief, rng: &mut KeyedRng) -> Self {
        let mut params = BTreeMap::new();
        for choice in effective_choices(brief) {
            let current = brief.param(&choice.param);
            let values: Vec<f64> = match (mode, choice.param.as_str()) {
                ("timeout", "time_limit_s") => {
                    choice.values.iter().copied().filter(|value| *value <= current).collect()
                }
                ("out_of_bounds", _) => choice.values.last().copied().into_iter().collect(),
                ("crash" | "saturation", "thrust_bound") if rng.bernoulli(0.5) => choice.values.clone(),
                _ => Vec::new(),
            };
            if let Some(count) = u32::try_from(values.len()).ok().filter(|count| *count > 0) {
                params.insert(choice.param.clone(), values[rng.below(count) as usize]);
            }
        }
        let value = |name: &str| params.get(name).copied().unwrap_or_else(|| brief.param(name));
        let (time_limit, acceleration) = (value("time_limit_s"), value("thrust_bound") / MASS_KG);
        Self { mode, brief, params, time_limit, acceleration }
    }

    /// Samples a design; `None` if the numbers that were drawn do not fit.
    fn design(self, rng: &mut KeyedRng) -> Option<DockingDesign> {
        let counts = DeputyCounts::of(self.brief);
        let least = if self.mode == "collision" { counts.min.max(2) } else { counts.min };
        let count = rng.range_inclusive(least, counts.max.max(least));
        let bearing_deg = self.sample_bearing_deg(rng);
        let mut first = scatter(self.aimed_deputy(rng)?, rng);
        let meeting = (self.mode == "collision").then(|| Meeting::sample(rng));
        if let Some(bearing) = bearing_deg {
            // A deputy sees the chief opposite to its own azimuth, a neighbour at larger azimuth about 105° beyond its own, and one
            // behind it at its own.
            let turn = match meeting {
                None => 180.0,
                Some(Meeting::Behind) => 0.0,
                Some(Meeting::Beside | Meeting::Crossing) => 105.0,
            };
            first.azimuth_deg = whole_degrees(BEARING.value(bearing) - turn).into();
            // The bearings of a failure profile lie in the plane of the orbit.
            first.elevation_deg /= 2;
        }
        let second = meeting.map(|meeting| meeting.second_deputy(&mut first, rng));
        let mut deputies: Vec<DeputyStart> = std::iter::once(first).chain(second).collect();
        let formation = Formation::sample(rng);
        for number in i32::try_from(deputies.len()).ok()?..count.cast_signed() {
            let repeats = self.mode != "collision" && rng.bernoulli(REPEAT_CHANCE);
            let other = if repeats { self.aimed_deputy(rng)? } else { self.ordinary_deputy(rng) };
            deputies.push(formation.place(other, &first, number, rng));
        }
        let aim = DockingAim { mode: self.mode.to_owned(), bearing_deg };
        Some(DockingDesign { name: String::new(), aim, params: self.params, deputies })
    }

    /// Samples the bearing of the aim from the sectors of the profile; `None` if the failures have none.
    fn sample_bearing_deg(&self, rng: &mut KeyedRng) -> Option<i32> {
        let empty = ModeProfile::default();
        let profile = self.brief.profile.mode(self.mode).unwrap_or(&empty);
        sample_sector_deg(&profile.sector_weights(), rng).map(i32::from)
    }

    /// Samples a deputy for the aimed failure, in any direction.
    fn aimed_deputy(&self, rng: &mut KeyedRng) -> Option<DeputyStart> {
        match self.mode {
            "crash" => self.crashing_deputy(rng),
            "saturation" => self.speeding_deputy(rng),
            "timeout" => Some(self.late_deputy(rng)),
            "out_of_bounds" => self.leaving_deputy(rng),
            _ => Some(self.ordinary_deputy(rng)),
        }
    }

    /// Samples a closing speed c and the share s of the way that braking takes, and solves for the way (c² − v₀²)/2as.
    fn crashing_deputy(&self, rng: &mut KeyedRng) -> Option<DeputyStart> {
        let closing = self.sample_contact_speed(rng);
        let share = uniform(rng, 0.35, 0.75);
        let speeds = closing * closing - DOCKING_SPEED_M_S * DOCKING_SPEED_M_S;
        let distance = DOCKING_RADIUS_M + speeds / (2.0 * self.acceleration * share);
        let percent = 100.0 * closing / speed_limit(distance);
        let fits = DISTANCE.value(DISTANCE.min) <= distance && percent <= f64::from(CLOSING.max);
        fits.then(|| deputy(distance, percent, uniform(rng, 0.0, 40.0), rng))
    }

    /// Samples the penalty of braking to the limit, and solves for the excess and a distance at which it is possible.
    fn speeding_deputy(&self, rng: &mut KeyedRng) -> Option<DeputyStart> {
        let excess = excess_for_penalty(uniform(rng, 0.55, 1.6), self.acceleration);
        let ratio = uniform(rng, 1.7, 4.5);
        let nearest = DOCKING_RADIUS_M + (excess / (ratio - 1.0) - DOCKING_SPEED_M_S) / LIMIT_SLOPE_1_S;
        let distance = nearest.max(uniform(rng, 25.0, 90.0));
        let percent = 100.0 * (1.0 + excess / speed_limit(distance));
        let (sin, cos) = libm::sincos(uniform(rng, 40.0, 120.0).to_radians());
        let fits = distance <= distance_at_limit(ORDINARY_TIME_SHARE * self.time_limit)
            && percent <= f64::from(CROSS.max);
        fits.then(|| deputy(distance, percent * cos, percent * sin, rng))
    }

    /// Samples the share of the time limit that the approach needs, and solves for the distance.
    fn late_deputy(&self, rng: &mut KeyedRng) -> DeputyStart {
        let needed = self.time_limit * uniform(rng, 0.77, 0.98);
        let closing_percent = uniform(rng, -40.0, 80.0);
        let mut distance = distance_at_limit(needed);
        // The time to reach the limit depends on the distance; the third value is within a second of the solution.
        for _ in 0..3 {
            let limit = speed_limit(distance.min(DISTANCE.value(DISTANCE.max)));
            let behind = limit * (1.0 - 0.01 * closing_percent);
            distance = distance_at_limit(needed - behind * behind / (2.0 * self.acceleration * limit));
        }
        deputy(distance, closing_percent, uniform(rng, 0.0, 60.0), rng)
    }

    /// Samples a distance and raises the speed away from the chief until coasting leads out of bounds.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 2000 s")]
    fn leaving_deputy(&self, rng: &mut KeyedRng) -> Option<DeputyStart> {
        let distance = uniform(rng, 250.0, DISTANCE.value(DISTANCE.max));
        let placed = scatter(deputy(distance, 0.0, uniform(rng, 0.0, 50.0), rng), rng);
        let leaves = |closing_speed: &i32| {
            let state = DeputyStart { closing_speed: *closing_speed, ..placed }.state();
            step_out_of_bounds(&state, self.time_limit as u32).is_some()
        };
        let slowest = (CLOSING.min..=-100).rev().step_by(20).find(leaves)?;
        let closing_speed = (slowest - rng.range_inclusive(0, 20).cast_signed()).max(CLOSING.min);
        Some(DeputyStart { closing_speed, ..placed })
    }

    /// Samples a deputy like those of the task's own starts, with time to spare.
    fn ordinary_deputy(&self, rng: &mut KeyedRng) -> DeputyStart {
        let farthest = distance_at_limit(ORDINARY_TIME_SHARE * self.time_limit);
        let distance = (self.brief.param("start_radius") * uniform(rng, 0.4, 1.0)).min(farthest);
        scatter(deputy(distance, uniform(rng, -10.0, 90.0), uniform(rng, 0.0, 50.0), rng), rng)
    }

    /// Samples a speed in m/s from a speed band of the profile, above the docking speed.
    fn sample_contact_speed(&self, rng: &mut KeyedRng) -> f64 {
        let edges = self.brief.recipe.task().speed_bands().edges;
        let profile = self.brief.profile.mode(self.mode);
        let weights = profile.map_or_else(Vec::new, |profile| profile.band_weights(edges.len() + 1));
        let is_known = weights.iter().sum::<f64>() > 0.0 && !rng.bernoulli(EXPLORATION);
        let Some(band) = rng.weighted_index(&weights).filter(|_| is_known) else {
            return uniform(rng, 0.3, 1.4);
        };
        let from = band.checked_sub(1).map_or(0.0, |below| edges[below]).max(0.3);
        let to = edges.get(band).copied().unwrap_or(1.6).max(0.5);
        uniform(rng, from, to)
    }
}

/// Way in which a second deputy meets the first one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Meeting {
    /// Both fly to the chief from nearby directions.
    Beside,
    /// The second one flies behind the first one, and the gap shrinks.
    Behind,
    /// The paths of the two cross.
    Crossing,
}

impl Meeting {
    fn sample(rng: &mut KeyedRng) -> Self {
        match rng.below(3) {
            0 => Self::Beside,
            1 => Self::Behind,
            _ => Self::Crossing,
        }
    }

    /// Samples the second deputy. May change speeds of `first`.
    fn second_deputy(self, first: &mut DeputyStart, rng: &mut KeyedRng) -> DeputyStart {
        let angle = 12 + rng.below(36).cast_signed();
        let beside = |first: &DeputyStart| DeputyStart {
            azimuth_deg: whole_degrees(f64::from(first.azimuth_deg + angle)).into(),
            ..*first
        };
        match self {
            Self::Beside => beside(first),
            Self::Behind => {
                // The gap shrinks with the speed limit on the way to the chief.
                let distance = DISTANCE.value(first.distance);
                let gap = uniform(rng, 0.3, 1.2) * speed_limit(distance) / DOCKING_SPEED_M_S;
                DeputyStart { distance: DISTANCE.nearest(distance + gap.max(1.2)), ..*first }
            }
            Self::Crossing => {
                // Both fly towards the middle between them, at one speed, and little towards the chief.
                first.cross_speed = CROSS.nearest(uniform(rng, 40.0, 110.0));
                first.closing_speed = CLOSING.nearest(uniform(rng, 0.0, 30.0));
                (first.cross_deg, first.elevation_deg) = (0, first.elevation_deg / 3);
                DeputyStart { cross_deg: 180, ..beside(first) }
            }
        }
    }
}

/// Returns a deputy with a distance in m and speeds in percent of the limit, and a random direction of the cross speed.
fn deputy(distance: f64, closing_percent: f64, cross_percent: f64, rng: &mut KeyedRng) -> DeputyStart {
    DeputyStart {
        distance: DISTANCE.nearest(distance),
        azimuth_deg: 0,
        elevation_deg: 0,
        closing_speed: CLOSING.nearest(closing_percent),
        cross_speed: CROSS.nearest(cross_percent),
        cross_deg: rng.below(360).cast_signed(),
    }
}

fn uniform(rng: &mut KeyedRng, from: f64, to: f64) -> f64 {
    from + (to - from) * rng.uniform()
}
