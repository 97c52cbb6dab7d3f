//! Debris of an episode: where it is after every step, since when the agents see it, and if a path is clear
//! of the debris that they know.

use std::cell::OnceCell;

use super::trace::{DebrisIdentity, EpisodeTrace};
use crate::kessler::constants::{CONTACT_2, EARTH_RADIUS_2, HORIZON, SATELLITES, SURVIVAL_THRESHOLD};
use crate::kessler::kernel::{Body, Gravity, distance_squared, min_distance_squared};
use crate::kessler::planner::ephemeris::DebrisEphemeris;
use crate::kessler::setup::{ContactModel, InitialState, KesslerSetup, Physics};
use crate::kessler::simulation::Satellite;

/// Value for debris that is visible at no step.
const NEVER_VISIBLE: u32 = u32::MAX;

/// Positions and visibility of all debris of an episode.
pub(super) struct DebrisVisibility<'a> {
    ephemeris: &'a DebrisEphemeris,
    trace: &'a EpisodeTrace,
    physics: Physics,
    radar_range: Option<f64>,
    /// Step in which each column of the ephemeris arrives; 0 for debris of the start.
    arrivals: Vec<u32>,
    /// First step after which each column is visible.
    first_visible: OnceCell<Vec<u32>>,
}

/// Path of a satellite that burns once and then holds.
#[derive(Debug, Clone, Copy)]
pub(super) struct BurnPath {
    /// Step of the burn, counted from 1.
    pub step: u32,
    /// Satellite before the burn.
    pub before: Body,
    /// Satellite after the burn.
    pub after: Body,
    /// Survival of the satellite before the step.
    pub survival: f64,
}

impl<'a> DebrisVisibility<'a> {
    /// Prepares the visibility of the debris of one episode.
    pub(super) fn new(
        setup: &KesslerSetup,
        start: &InitialState,
        ephemeris: &'a DebrisEphemeris,
        trace: &'a EpisodeTrace,
    ) -> Self {
        let mut arrivals = vec![0; start.debris.len()];
        arrivals.extend(start.rogues.iter().map(|rogue| rogue.step));
        let KesslerSetup { physics, radar_range, .. } = *setup;
        Self { ephemeris, trace, physics, radar_range, arrivals, first_visible: OnceCell::new() }
    }

    /// First step after which the debris exists.
    pub(super) fn arrival(&self, debris: DebrisIdentity) -> u32 {
        match debris {
            DebrisIdentity::Initial(column) | DebrisIdentity::Rogue(column) => {
                self.arrivals.get(column).copied().unwrap_or(0)
            }
            DebrisIdentity::Fragment(index) => self.trace.fragments.get(index).map_or(0, |f| f.first_step),
        }
    }

    /// Position of the debris after `step`, LU; `None` if it does not exist then.
    pub(super) fn position(&self, debris: DebrisIdentity, step: u32) -> Option<(f64, f64)> {
        let age = step.checked_sub(self.arrival(debris))?;
        match debris {
            DebrisIdentity::Initial(column) | DebrisIdentity::Rogue(column) => {
                Some(self.ephemeris.position(column, step as usize))
            }
            DebrisIdentity::Fragment(index) => {
                let body = self.trace.fragments.get(index)?.bodies.get(age as usize)?;
                Some((body.x, body.y))
            }
        }
    }

    /// First step below `before` after which some active satellite sees the debris.
    pub(super) fn first_visible_step(&self, debris: DebrisIdentity, before: u32) -> Option<u32> {
        let is_visible = |step: &u32| {
            self.position(debris, *step).is_some_and(|(x, y)| self.is_point_visible(*step, x, y))
        };
        (self.arrival(debris)..before).find(is_visible)
    }

    /// Returns true if the burn path is safe as far as the agents can know before its step: clear of the
    /// Earth, and of all debris visible by then, through the horizon.
    pub(super) fn is_clear_of_known(&self, path: BurnPath) -> bool {
        let BurnPath { step: from, mut before, after: mut body, mut survival } = path;
        let is_known = |fragment: &DebrisIdentity| self.first_visible_step(*fragment, from).is_some();
        let known_fragments: Vec<DebrisIdentity> =
            (0..self.trace.fragments.len()).map(DebrisIdentity::Fragment).filter(is_known).collect();
        for step in from..=HORIZON {
            if body.radius_squared() < EARTH_RADIUS_2 {
                return false;
            }
            body = body.coast(self.physics.gravity);
            let t = step as usize;
            if let ContactModel::Probability(sigma) = self.physics.contact {
                self.ephemeris.for_each_close_column(t, &before, &body, sigma, |column| {
                    let factor = self.ephemeris.survival_factor(column, t, &before, &body, sigma);
                    survival *= if factor < 1.0 && self.is_column_known(column, from) { factor } else { 1.0 };
                });
                if survival < SURVIVAL_THRESHOLD {
                    return false;
                }
            }
            let known_hit =
                |i: usize| self.ephemeris.column_hits(i, t, &body) && self.is_column_known(i, from);
            if self.ephemeris.destroys(t, &body) && (0..self.ephemeris.len()).any(known_hit) {
                return false;
            }
            if known_fragments.iter().any(|&fragment| self.fragment_hits(fragment, step, &body)) {
                return false;
            }
            before = body;
        }
        true
    }

    /// Probability that one debris body does not hit a satellite in `step`, which moves it from `before` to
    /// `body`. It is 0 or 1 if debris destroys what it touches.
    pub(super) fn survival_factor(
        &self,
        debris: DebrisIdentity,
        step: u32,
        before: &Body,
        body: &Body,
    ) -> f64 {
        let is_hit = match (debris, self.physics.contact) {
            (
                DebrisIdentity::Initial(column) | DebrisIdentity::Rogue(column),
                ContactModel::Probability(sigma),
            ) => {
                return self.ephemeris.survival_factor(column, step as usize, before, body, sigma);
            }
            (DebrisIdentity::Initial(column) | DebrisIdentity::Rogue(column), _) => {
                self.ephemeris.column_hits(column, step as usize, body)
            }
            (DebrisIdentity::Fragment(_), _) => self.fragment_hits(debris, step, body),
        };
        if is_hit { 0.0 } else { 1.0 }
    }

    /// Gravity model of the episode.
    pub(super) const fn gravity(&self) -> Gravity {
        self.physics.gravity
    }

    /// [`KesslerSim::is_visible`](crate::kessler::simulation::KesslerSim::is_visible) after a step of the
    /// trace.
    fn is_point_visible(&self, step: u32, x: f64, y: f64) -> bool {
        let is_within = |s: &Satellite, range: f64| {
            s.is_active() && distance_squared(s.body.x, s.body.y, x, y) <= range * range
        };
        self.radar_range
            .is_none_or(|range| (0..SATELLITES).any(|i| is_within(self.trace.satellite(i, step), range)))
    }

    /// Returns true if a column was visible before the burns of `step`. Its orbit is known from then on.
    fn is_column_known(&self, column: usize, step: u32) -> bool {
        let first_visible = self.first_visible.get_or_init(|| {
            let steps = self.trace.outcome.steps;
            let first = |column| self.first_visible_step(DebrisIdentity::Initial(column), steps);
            (0..self.ephemeris.len()).map(|column| first(column).unwrap_or(NEVER_VISIBLE)).collect()
        });
        first_visible.get(column).is_some_and(|&first| first < step)
    }

    /// Returns true if a fragment hits a satellite in `step`. `body` is the satellite's state at the end of
    /// the step.
    fn fragment_hits(&self, debris: DebrisIdentity, step: u32, body: &Body) -> bool {
        let DebrisIdentity::Fragment(index) = debris else { return false };
        let Some(fragment) = self.trace.fragments.get(index) else { return false };
        let Some(age) = step.checked_sub(fragment.first_step) else { return false };
        let Some(piece) = fragment.bodies.get(age as usize) else { return false };
        let (dx, dy) = (body.x - piece.x, body.y - piece.y);
        let d2 = if self.physics.contact == ContactModel::Swept && age > 0 {
            min_distance_squared(dx, dy, body.vx - piece.vx, body.vy - piece.vy)
        } else {
            dx * dx + dy * dy
        };
        d2 < CONTACT_2
    }
}
