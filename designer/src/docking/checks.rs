//! Checks of designs and layouts before the planner: a design compiles and matches its aim, and an agent can still act when
//! its first observation shows it a start.

use env_core::Scenario;
use env_core::docking::constants::{
    COLLISION_DISTANCE_M, DOCKING_RADIUS_M, MAX_DISTANCE_M, MIN_VELOCITY_PENALTY, VIOLATION_COST,
};
use env_core::docking::setup::DockingSetup;
use env_core::episode_rng::SeededRng;

use super::aim::check_aim;
use super::approach::{StartApproach, nearest_pass};
use super::compile::compile;
use super::design::DockingDesign;
use crate::field_error::FieldError;
use crate::refusal::Refusal;

/// Time for which an agent may coast before it acts, s.
const REACTION_S: f64 = 5.0;
/// Steps within which a contact of two coasting deputies is looked for.
const CONTACT_STEPS: u32 = 60;

/// Compiles a design in a base scenario and checks that it matches its aim. Returns the scenario.
///
/// # Errors
/// Returns [`Refusal::Compiles`] or [`Refusal::Aim`].
pub(super) fn build(design: &DockingDesign, base: &Scenario) -> Result<Scenario, Refusal> {
    let scenario = compile(design, base).map_err(Refusal::Compiles)?;
    let setup = DockingSetup::read(scenario.recipe()).map_err(Refusal::Unfair)?;
    check_aim(design, &setup).map_err(Refusal::Aim)?;
    Ok(scenario)
}

/// Returns true if a design passes all checks before the planner in a base scenario.
pub(super) fn is_playable(design: &DockingDesign, base: &Scenario) -> bool {
    build(design, base).is_ok_and(|scenario| check_reaction(&scenario).is_ok())
}

/// Checks that each deputy starts outside the docking radius and within bounds. After five seconds without thrust, braking must
/// still prevent a crash, saturation and leaving bounds, and thrust must still keep deputies apart.
///
/// # Errors
/// Returns an error with the deputy, and a way to fix the layout.
pub(super) fn check_reaction(scenario: &Scenario) -> Result<(), FieldError> {
    let Ok(setup) = DockingSetup::read(scenario.recipe()) else { return Ok(()) };
    // The admission check reports an unfair start in its own words.
    let Ok(start) = setup.sample_starts(&mut SeededRng::new(scenario.seed())) else { return Ok(()) };
    let states = &start.states[..start.deputies];
    for (index, state) in states.iter().enumerate() {
        let field = format!("deputies.{index}");
        let approach = StartApproach::new(state, setup.thrust_bound);
        if let Some(message) = unpreventable(&approach) {
            return Err(FieldError::new(field, message));
        }
        for (other, other_state) in states[..index].iter().enumerate() {
            let pass = nearest_pass(state, other_state, CONTACT_STEPS);
            let evasion_s = REACTION_S + (COLLISION_DISTANCE_M / approach.acceleration).sqrt();
            if pass.separation < COLLISION_DISTANCE_M && f64::from(pass.step) < evasion_s {
                let message = format!(
                    "hits deputies.{other} after {} s, but thrust needs {evasion_s:.0} s to keep them apart; choose a larger \
                     distance or a lower speed",
                    pass.step
                );
                return Err(FieldError::new(field, message));
            }
        }
    }
    Ok(())
}

/// Returns the failure that no thrust can prevent after the reaction time, and a fix; `None` if there is none.
fn unpreventable(approach: &StartApproach) -> Option<String> {
    let coasted = REACTION_S * approach.closing.max(0.0);
    let way_left = approach.distance - coasted;
    let after = StartApproach { distance: way_left, ..*approach };
    if approach.distance <= DOCKING_RADIUS_M || way_left <= DOCKING_RADIUS_M || after.braking_share() > 1.0 {
        return Some(format!(
            "closes at {:.2} m/s from {:.1} m, which full thrust cannot brake {REACTION_S} s later; choose a lower closing \
             speed or a larger distance",
            approach.closing, approach.distance
        ));
    }
    let excess = approach.excess();
    let while_coasting = if excess > 0.0 { REACTION_S * VIOLATION_COST * (1.0 + excess) } else { 0.0 };
    let penalty = while_coasting + approach.braking_penalty();
    if penalty >= -MIN_VELOCITY_PENALTY {
        return Some(format!(
            "is {excess:.2} m/s above the speed limit: braking to it costs a velocity penalty of {penalty:.1}, and {} stops \
             the deputy; choose a lower speed",
            -MIN_VELOCITY_PENALTY
        ));
    }
    let farthest = approach.turning_distance() + REACTION_S * (-approach.closing).max(0.0);
    (farthest > MAX_DISTANCE_M).then(|| {
        format!("leaves bounds before full thrust can turn it, {farthest:.0} m away; choose a lower speed")
    })
}
