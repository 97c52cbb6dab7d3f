//! Whether a loss could have been avoided, by a plan that knows only what was visible when it acts: one burn, then hold.

use super::plans::Plans;
use super::sky::Sky;
use super::trace::{Trace, Who};
use crate::critique::Remedy;
use crate::kessler::constants::{EARTH_RADIUS_2, FUEL_PER_SPEED, HORIZON};
use crate::kessler::kernel::clamped_burn;
use crate::kessler::planner::panel::capped;
use crate::kessler::planner::table::Path;

const TAU: f64 = std::f64::consts::TAU;
/// Sizes of burns, LU/TU, gentlest first. The first is no burn at all: hold from that step on.
const SIZES: [f64; 7] = [0.0, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0];
const DIRECTIONS: u32 = 16;
/// Most steps that are tried, spread evenly from the first to the last.
const STEPS: u32 = 20;
/// Steps past the loss that a plan must live in truth: one that runs into something unseen right after is no remedy.
/// What comes later could be met by a later burn.
const GRACE: u32 = 5;

/// A loss to be avoided.
#[derive(Debug, Clone, Copy)]
pub(super) struct Danger {
    pub(super) satellite: usize,
    /// The first step that somebody could act in.
    pub(super) from: u32,
    /// The step of the loss.
    pub(super) step: u32,
    /// What hit it; none is the Earth.
    pub(super) who: Option<Who>,
    /// Fuel to act with; none is what the satellite had then.
    pub(super) fuel: Option<f64>,
}

/// One burn that is tried, and the fuel there is for it.
struct Try {
    step: u32,
    dvx: f64,
    dvy: f64,
    fuel: f64,
}

/// The cheapest burn found that avoids the loss: gentlest first, of one size the latest first, 16 directions.
pub(super) fn search(plans: &Plans<'_>, sky: &Sky<'_>, trace: &Trace, danger: Danger) -> Option<Remedy> {
    let stride = (danger.step + 1).checked_sub(danger.from)?.div_ceil(STEPS).max(1);
    let mut path = plans.paths[danger.satellite].clone();
    let mut last = -1.0;
    for size in SIZES {
        let mut affordable = false;
        for step in (danger.from..danger.step + 1).step_by(stride as usize).rev() {
            let fuel = danger.fuel.unwrap_or_else(|| trace.satellite(danger.satellite, step - 1).fuel);
            let most = capped(size, fuel);
            if most <= last {
                continue; // no more than the size before
            }
            affordable = true;
            for direction in 0..if size > 0.0 { DIRECTIONS } else { 1 } {
                let (sin, cos) = libm::sincos(TAU * f64::from(direction) / f64::from(DIRECTIONS));
                let burn = Try { step, dvx: most * cos, dvy: most * sin, fuel };
                if works(plans, sky, trace, danger, &burn, &mut path) {
                    let cost = FUEL_PER_SPEED * most;
                    return Some(Remedy { step, values: vec![burn.dvx, burn.dvy], cost });
                }
            }
        }
        if !affordable {
            return None;
        }
        last = size;
    }
    None
}

/// It clears what took the satellite; it clears everything known then, to the end; and in truth it outlives the loss.
fn works(
    plans: &Plans<'_>,
    sky: &Sky<'_>,
    trace: &Trace,
    danger: Danger,
    burn: &Try,
    path: &mut Path,
) -> bool {
    let mut body = trace.satellite(danger.satellite, burn.step - 1).body;
    let (dvx, dvy, _) = clamped_burn(burn.dvx, burn.dvy);
    body.vx += dvx;
    body.vy += dvy;
    let begin = body;
    for t in burn.step..=danger.step {
        if body.radius_2() < EARTH_RADIUS_2 {
            return false;
        }
        body = body.coasted();
        if danger.who.is_some_and(|who| sky.touches(who, t, &body)) {
            return false;
        }
    }
    if !sky.clear(begin, burn.step) {
        return false;
    }
    plans.instead(danger.satellite, burn.step, (burn.dvx, burn.dvy), burn.fuel, path);
    let until = (danger.step + GRACE).min(HORIZON);
    plans.loss(danger.satellite, path).is_none_or(|loss| loss.step > until)
}
