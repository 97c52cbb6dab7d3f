//! Search for a remedy: a plan of one burn and then hold that would have avoided a loss and uses only what
//! was visible when it acts.

use std::f64::consts::TAU;

use super::counterfactuals::{Counterfactuals, TrialBurn};
use super::trace::{DebrisIdentity, EpisodeTrace};
use super::visibility::{BurnPath, DebrisVisibility};
use crate::critique::Remedy;
use crate::kessler::constants::{EARTH_RADIUS_2, HORIZON, SURVIVAL_THRESHOLD};
use crate::kessler::kernel::{Body, ClampedBurn, clamp_burn};
use crate::kessler::planner::panel::affordable_size;
use crate::kessler::planner::trajectory::Trajectory;

/// Sizes of the burns tried, LU/TU, gentlest first. The first is no burn at all: hold from that step on.
const REMEDY_BURN_SIZES: [f64; 7] = [0.0, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0];
/// Number of directions of the burns tried.
const REMEDY_DIRECTIONS: u32 = 16;
/// Largest number of steps tried, spread evenly from the first to the last.
const MAX_REMEDY_STEPS: u32 = 20;
/// Steps after the loss that a remedy must survive in the engine: one that runs into hidden debris right
/// after it is no remedy. A later burn could avoid what comes after.
const GRACE_STEPS: u32 = 5;

/// Loss that a remedy has to avoid.
#[derive(Debug, Clone, Copy)]
pub(super) struct LossToAvoid {
    pub satellite: usize,
    /// First step in which the satellite could act.
    pub from: u32,
    /// Step of the loss.
    pub step: u32,
    /// Debris that caused it; `None` if the satellite fell into the Earth.
    pub debris: Option<DebrisIdentity>,
    /// Fuel to act with; `None` for the fuel that the satellite had at the time.
    pub fuel: Option<f64>,
}

/// Finds the cheapest burn that avoids the loss. Sizes are tried from small to large, steps from late to
/// early, in 16 directions.
pub(super) fn find_remedy(
    counterfactuals: &Counterfactuals<'_>,
    visibility: &DebrisVisibility<'_>,
    trace: &EpisodeTrace,
    loss: LossToAvoid,
) -> Option<Remedy> {
    let stride = (loss.step + 1).checked_sub(loss.from)?.div_ceil(MAX_REMEDY_STEPS).max(1);
    let mut trajectory = counterfactuals.trajectories[loss.satellite].clone();
    let mut previous_size = -1.0;
    for size in REMEDY_BURN_SIZES {
        let mut is_any_affordable = false;
        for step in (loss.from..loss.step + 1).step_by(stride as usize).rev() {
            let fuel = loss.fuel.unwrap_or_else(|| trace.satellite(loss.satellite, step - 1).fuel);
            let affordable = affordable_size(size, fuel);
            if affordable <= previous_size {
                continue; // No larger than the size before.
            }
            is_any_affordable = true;
            for direction in 0..if size > 0.0 { REMEDY_DIRECTIONS } else { 1 } {
                let (sin, cos) = libm::sincos(TAU * f64::from(direction) / f64::from(REMEDY_DIRECTIONS));
                let burn = TrialBurn { step, dvx: affordable * cos, dvy: affordable * sin, fuel };
                if avoids_loss(counterfactuals, visibility, trace, loss, &burn, &mut trajectory) {
                    let ClampedBurn { cost, .. } = clamp_burn(burn.dvx, burn.dvy);
                    return Some(Remedy { step, values: vec![burn.dvx, burn.dvy], cost });
                }
            }
        }
        if !is_any_affordable {
            return None;
        }
        previous_size = size;
    }
    None
}

/// Returns true if the burn clears the debris that caused the loss, is clear of all debris known at its step
/// through the horizon, and survives the loss in the engine.
fn avoids_loss(
    counterfactuals: &Counterfactuals<'_>,
    visibility: &DebrisVisibility<'_>,
    trace: &EpisodeTrace,
    loss: LossToAvoid,
    burn: &TrialBurn,
    trajectory: &mut Trajectory,
) -> bool {
    let satellite = trace.satellite(loss.satellite, burn.step - 1);
    let ClampedBurn { dvx, dvy, .. } = clamp_burn(burn.dvx, burn.dvy);
    let before = satellite.body;
    let after = Body { vx: before.vx + dvx, vy: before.vy + dvy, ..before };
    let path = BurnPath { step: burn.step, before, after, survival: satellite.survival };
    if !clears_cause(visibility, loss, path) || !visibility.is_clear_of_known(path) {
        return false;
    }
    let until = (loss.step + GRACE_STEPS).min(HORIZON);
    counterfactuals.with_trial_burn(loss.satellite, burn, until, trajectory);
    counterfactuals.survives_through(loss.satellite, trajectory, until)
}

/// Returns true if the path clears the debris that caused the loss, up to its step. This check is cheap, and
/// most burns fail it.
fn clears_cause(visibility: &DebrisVisibility<'_>, loss: LossToAvoid, path: BurnPath) -> bool {
    let BurnPath { step: from, mut before, after: mut body, mut survival } = path;
    for step in from..=loss.step {
        if body.radius_squared() < EARTH_RADIUS_2 {
            return false;
        }
        body = body.coast(visibility.gravity());
        survival *=
            loss.debris.map_or(1.0, |debris| visibility.survival_factor(debris, step, &before, &body));
        if survival < SURVIVAL_THRESHOLD {
            return false;
        }
        before = body;
    }
    true
}
