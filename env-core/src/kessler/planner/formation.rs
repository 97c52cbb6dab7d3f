//! Keeping a triangle. The law is deadbeat (a burn moves the next place by itself, since `p += v` comes last): foresee
//! where the three will be without a burn, lay the nearest triangle of the right side over that, and burn by what is
//! missing. Only the shape is kept: where the triangle goes and how it turns is left to nature, which costs least. The
//! planner searches the law's few gains, how far to look ahead for debris, and sidesteps where somebody is hit all the
//! same.

use super::ahead::LookAhead;
use super::judge::judge;
use super::panel::PANEL;
use super::table::{Path, Table};
use super::transfer::affordable;
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::constants::{FORMATION_SIDE, GOAL, HORIZON, SATELLITES};
use crate::kessler::kernel::{Body, Gravity};
use crate::kessler::reward::Objective;
use crate::kessler::setup::Setup;
use crate::seed::Seed;

/// The law's gains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::kessler) struct Keeping {
    /// Steps foreseen; what is missing then is made up for in equal parts.
    pub ahead: u32,
    /// Share of what is missing that is burnt for.
    pub gain: f64,
    /// What is missing less than this, LU, is left.
    pub tolerance: f64,
    /// No keeping after this step.
    pub until: u32,
}

impl Keeping {
    /// Gains that hold a triangle well at any fuel that allows it: what the causal pilot flies.
    pub(in crate::kessler) const STEADY: Self = Self { ahead: 2, gain: 0.6, tolerance: 0.5, until: HORIZON };
}

/// Trials with random gains, and then around the best.
const RANDOM: u32 = 70;
const LOCAL: u32 = 50;
/// Sidesteps tried where somebody is hit.
const SIDESTEPS: u32 = 220;
/// A sidestep keeps its course for at most so many steps.
const ASIDE: f64 = 8.0;

/// The three burns that restore the shape, LU/TU.
pub(in crate::kessler) fn keep(
    bodies: &[Body; SATELLITES],
    gains: &Keeping,
    gravity: Gravity,
) -> [(f64, f64); SATELLITES] {
    let mut foreseen = *bodies;
    for _ in 0..gains.ahead {
        foreseen = foreseen.map(|body| body.coasted(gravity));
    }
    let part = gains.gain / f64::from(gains.ahead.max(1));
    missing(&foreseen).map(|(x, y)| {
        if x * x + y * y < gains.tolerance * gains.tolerance { (0.0, 0.0) } else { (part * x, part * y) }
    })
}

/// What each place lacks to the nearest equilateral triangle of the right side, by least squares: its centre is the
/// centroid, and its turn that of the orthogonal Procrustes problem in the plane (Schönemann 1966).
fn missing(places: &[Body; SATELLITES]) -> [(f64, f64); SATELLITES] {
    const HALF_ROOT_3: f64 = 0.866_025_403_784_438_6;
    /// Corners of the triangle on the unit circle.
    const CORNERS: [(f64, f64); SATELLITES] = [(1.0, 0.0), (-0.5, HALF_ROOT_3), (-0.5, -HALF_ROOT_3)];
    let circumradius = FORMATION_SIDE / (2.0 * HALF_ROOT_3);
    let third = 1.0 / SATELLITES as f64;
    let cx = (places[0].x + places[1].x + places[2].x) * third;
    let cy = (places[0].y + places[1].y + places[2].y) * third;
    let (mut along, mut across) = (0.0, 0.0);
    for (place, (ox, oy)) in places.iter().zip(CORNERS) {
        let (x, y) = (place.x - cx, place.y - cy);
        along += ox * x + oy * y;
        across += ox * y - oy * x;
    }
    let size = (along * along + across * across).sqrt().max(f64::MIN_POSITIVE);
    let (cos, sin) = (along / size, across / size);
    std::array::from_fn(|i| {
        let (ox, oy) = CORNERS[i];
        let (x, y) = (circumradius * (cos * ox - sin * oy), circumradius * (sin * ox + cos * oy));
        (cx + x - places[i].x, cy + y - places[i].y)
    })
}

/// One satellite leaves its place for a while.
#[derive(Debug, Clone, Copy)]
struct Sidestep {
    satellite: usize,
    step: u32,
    /// It burns again from this step on.
    until: u32,
    dv: (f64, f64),
}

/// Everything a trial needs.
struct Search<'a> {
    setup: &'a Setup,
    seed: Seed,
    table: &'a Table,
    holds: [&'a Path; SATELLITES],
    best: [Path; SATELLITES],
    worth: f64,
    trial: [Path; SATELLITES],
}

/// The best formation flight found, for as long as it is `wanted`; `planned` is what avoidance alone gives.
pub(super) fn search(
    setup: &Setup,
    seed: Seed,
    table: &Table,
    panels: &[Vec<Path>; SATELLITES],
    planned: [Path; SATELLITES],
    chance: &mut Seeded,
    wanted: &dyn Fn() -> bool,
) -> [Path; SATELLITES] {
    debug_assert_eq!(panels[0].len(), PANEL);
    let holds = [&panels[0][0], &panels[1][0], &panels[2][0]];
    let trial = holds.map(Path::clone);
    let mut search = Search { setup, seed, table, holds, best: planned, worth: 0.0, trial };
    search.worth = search.worth_of(&search.best);
    let mut gains = Keeping::STEADY;
    let mut look = LookAhead::STEADY;
    search.fly(&gains, &look, None);
    search.keep_if_better();
    for number in 0..RANDOM + LOCAL {
        if !wanted() {
            return search.best;
        }
        let next = if number < RANDOM { anywhere(chance) } else { around(gains, chance) };
        let watch = lookout(chance);
        search.fly(&next, &watch, None);
        if search.keep_if_better() {
            (gains, look) = (next, watch);
        }
    }
    for _ in 0..SIDESTEPS {
        let Some(threat) = search.threat(chance).filter(|_| wanted()) else { break };
        let sidestep = aside(threat, chance);
        search.fly(&gains, &look, Some(sidestep));
        search.keep_if_better();
    }
    search.best
}

fn anywhere(chance: &mut Seeded) -> Keeping {
    let mut draw = |low: f64, high: f64| chance.between(Stream::Planner, low, high);
    Keeping {
        ahead: draw(1.0, 7.0) as u32,
        gain: draw(0.1, 1.0),
        tolerance: draw(0.0, 4.0) * draw(0.0, 1.0),
        until: if draw(0.0, 1.0) < 0.6 { HORIZON } else { draw(20.0, 50.0) as u32 },
    }
}

/// With hindsight it pays to look farther, and to act sooner or later.
fn lookout(chance: &mut Seeded) -> LookAhead {
    let mut draw = |low: f64, high: f64| chance.between(Stream::Planner, low, high);
    let act_within = draw(2.0, 14.0) as u32;
    LookAhead { steps: act_within + draw(2.0, 10.0) as u32, act_within, margin: draw(1.0, 2.0) }
}

fn around(near: Keeping, chance: &mut Seeded) -> Keeping {
    let mut draw = |spread: f64| chance.between(Stream::Planner, -spread, spread);
    Keeping {
        ahead: (f64::from(near.ahead) + draw(1.5)).clamp(1.0, 8.0) as u32,
        gain: (near.gain + draw(0.2)).clamp(0.05, 1.0),
        tolerance: (near.tolerance + draw(0.7)).max(0.0),
        until: (f64::from(near.until) + draw(6.0)).clamp(10.0, f64::from(HORIZON)) as u32,
    }
}

/// A sidestep of the satellite that is lost at `threat`, not long before.
fn aside((satellite, lost): (usize, u32), chance: &mut Seeded) -> Sidestep {
    let mut draw = |low: f64, high: f64| chance.between(Stream::Planner, low, high);
    let step = (f64::from(lost) - draw(0.0, 6.0)).max(1.0) as u32;
    let size = draw(0.1, 1.0);
    let (sin, cos) = libm::sincos(draw(0.0, std::f64::consts::TAU));
    let until = lost.max(step) + 1 + draw(0.0, ASIDE) as u32;
    Sidestep { satellite, step, until, dv: (size * cos, size * sin) }
}

impl Search<'_> {
    /// Flies the law, dodging what comes, with an optional sidestep, into `trial`.
    fn fly(&mut self, gains: &Keeping, look: &LookAhead, sidestep: Option<Sidestep>) {
        for (path, hold) in self.trial.iter_mut().zip(self.holds) {
            path.branch(hold, 1);
        }
        for step in 1..=HORIZON {
            let t = step as usize;
            let keeping = step <= gains.until && self.trial.iter().all(|path| path.loss.is_none());
            let burns = if keeping {
                let bodies = std::array::from_fn(|i| self.trial[i].bodies[t - 1]);
                keep(&bodies, gains, self.table.physics.gravity)
            } else {
                [(0.0, 0.0); SATELLITES]
            };
            for (i, path) in self.trial.iter_mut().enumerate() {
                if path.loss.is_some() {
                    continue;
                }
                let (dvx, dvy) = match sidestep.filter(|s| s.satellite == i) {
                    Some(s) if s.step == step => s.dv,
                    Some(s) if s.step < step && step < s.until => (0.0, 0.0),
                    _ => burns[i],
                };
                let fuel = path.fuel[t - 1];
                let planned = affordable(dvx, dvy, fuel);
                let burn = look.dodge(path.bodies[t - 1], fuel, planned, self.table, t - 1);
                path.advance(self.table, step, burn);
            }
        }
    }

    /// The score, and a bonus for what makes an episode a success.
    fn worth_of(&self, paths: &[Path; SATELLITES]) -> f64 {
        let [a, b, c] = paths;
        let flown = judge(Objective::Formation, self.setup, self.seed, self.table, [a, b, c]);
        let success = flown.lost == 0 && flown.goal.is_some_and(|goal| goal >= GOAL);
        flown.score + f64::from(u8::from(success))
    }

    fn keep_if_better(&mut self) -> bool {
        let worth = self.worth_of(&self.trial);
        let better = worth > self.worth;
        if better {
            self.worth = worth;
            self.best.clone_from(&self.trial);
        }
        better
    }

    /// A satellite that is lost in the best flight so far, and when; one of them by chance where there are several.
    fn threat(&self, chance: &mut Seeded) -> Option<(usize, u32)> {
        let lost: Vec<(usize, u32)> =
            self.best.iter().enumerate().filter_map(|(i, path)| Some((i, path.threat()?))).collect();
        let pick = chance.between(Stream::Planner, 0.0, lost.len() as f64) as usize;
        lost.get(pick).copied()
    }
}
