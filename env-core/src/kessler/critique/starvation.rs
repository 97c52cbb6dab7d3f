//! Fuel that was short where it would have helped: burns that were refused, or a threat that a full tank would have met.

use super::Case;
use super::loss::Loss;
use super::mode::Mode;
use super::remedy::{Danger, search};
use crate::critique::{Failure, Measure};
use crate::kessler::constants::{FUEL_PER_SPEED, MAX_BURN, SATELLITES};

/// A better goal by so much counts as help.
const GOAL_GAIN: f64 = 0.05;

/// At most one a satellite.
pub(super) fn all(case: &Case<'_>, losses: &[Loss]) -> Vec<Failure> {
    (0..SATELLITES)
        .filter_map(|satellite| {
            let loss = losses.iter().find(|loss| loss.satellite == satellite);
            refused(case, satellite).or_else(|| powerless(case, loss?))
        })
        .collect()
}

/// Had every burn of this satellite's been granted: fewer lost, or the goal better held.
fn refused(case: &Case<'_>, satellite: usize) -> Option<Failure> {
    let mut refused = case.trace.refused.iter().filter(|r| r.satellite == satellite && r.cost.is_finite());
    let first = refused.next()?;
    let count = 1 + refused.count();
    let flown = case.flown();
    let fell_short = flown.goal.is_some_and(|goal| goal < crate::kessler::constants::GOAL);
    if flown.lost == 0 && !fell_short {
        return None;
    }
    let granted = case.plans.with(satellite, &case.plans.granted(satellite)).flown;
    let better = granted.goal.unwrap_or(0.0) - flown.goal.unwrap_or(0.0);
    let saved = flown.lost.saturating_sub(granted.lost);
    if granted.lost > flown.lost || (saved == 0 && better < GOAL_GAIN) {
        return None;
    }
    let helped = if saved > 0 { "somebody would have lived" } else { "the goal would have been better held" };
    Some(Failure {
        mode: Mode::FuelStarvation.name(),
        agent: satellite as u32,
        step: first.step,
        encounter: None,
        measures: vec![
            Measure { name: "refused_burns", value: count as f64, unit: "" },
            Measure { name: "cost", value: first.cost, unit: "fuel" },
            Measure { name: "fuel_left", value: first.fuel, unit: "fuel" },
        ],
        words: format!(
            "Satellite {satellite} was short of fuel from step {} on ({:.2} wanted, {:.2} left): with all it asked \
             for {helped}.",
            first.step, first.cost, first.fuel
        ),
    })
}

/// What was left could not avoid what a full tank could have.
fn powerless(case: &Case<'_>, loss: &Loss) -> Option<Failure> {
    let encounter = loss.failure.encounter.as_ref()?;
    let seen = encounter.first_visible_step.filter(|_| encounter.avoidable == Some(false))?;
    let left = case.trace.satellite(loss.satellite, seen).fuel;
    let full = case.setup.fuel;
    if left >= full || left >= FUEL_PER_SPEED * MAX_BURN {
        return None; // more fuel would have allowed no other burn
    }
    let who = loss.end.met.map(|met| met.who);
    let danger =
        Danger { satellite: loss.satellite, from: seen + 1, step: loss.end.step, who, fuel: Some(full) };
    let remedy = search(case.plans, case.sky, case.trace, danger)?;
    Some(Failure {
        mode: Mode::FuelStarvation.name(),
        agent: loss.satellite as u32,
        step: seen + 1,
        encounter: None,
        measures: vec![
            Measure { name: "cost", value: remedy.cost, unit: "fuel" },
            Measure { name: "fuel_left", value: left, unit: "fuel" },
        ],
        words: format!(
            "Satellite {} had {left:.2} fuel left when it could see what hit it; {:.2} at step {} would have avoided it.",
            loss.satellite, remedy.cost, remedy.step
        ),
    })
}
