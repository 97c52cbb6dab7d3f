//! Rendezvous: satellite 0 lives and does not hold radius 100 as the goal asks.

use super::Case;
use super::mode::Mode;
use crate::critique::{Failure, Measure};
use crate::kessler::constants::{GOAL, HORIZON, PROXIMITY_WIDTH, RENDEZVOUS_STEPS, TARGET_RADIUS};
use crate::kessler::kernel::Body;
use crate::kessler::reward::{Objective, proximity};

/// Within this of the target radius, LU, proximity is at least what the goal asks on average.
const BAND: f64 = PROXIMITY_WIDTH * (1.0 - GOAL);

/// Why the goal was missed. Where satellite 0 was lost, that is why.
pub(super) fn missed(case: &Case<'_>) -> Option<Failure> {
    let goal = case.flown().goal.filter(|&goal| goal < GOAL)?;
    if case.objective != Objective::Rendezvous || case.trace.ends[0].is_some() {
        return None;
    }
    let bodies: Vec<Body> = (0..=HORIZON).map(|step| case.trace.satellite(0, step).body).collect();
    if let Some(failure) = doubtful(case, goal, &[0], |step| proximity(bodies[step].radius())) {
        return Some(failure);
    }
    let off = |step: usize| (bodies[step].radius() - TARGET_RADIUS).abs();
    let crossed =
        |step: usize| (bodies[step - 1].radius() < TARGET_RADIUS) != (bodies[step].radius() < TARGET_RADIUS);
    let last = HORIZON as usize;
    let arrived = (1..=last).find(|&step| off(step) <= BAND || crossed(step));
    let left = arrived.and_then(|first| (first..=last).find(|&step| off(step) > BAND));
    Some(match (arrived, left) {
        (Some(first), Some(left)) => overshoot(&bodies, goal, first, left),
        _ => short(&bodies, goal, arrived),
    })
}

/// Under `risk: pc` the goal counts by the survival of these satellites: it was held, and they were not safe enough.
/// `nearness` is how near the goal was after a step, whoever lives.
pub(super) fn doubtful(
    case: &Case<'_>,
    goal: f64,
    satellites: &[usize],
    nearness: impl Fn(usize) -> f64,
) -> Option<Failure> {
    let steps = case.objective.goal_steps();
    let held =
        (HORIZON - steps + 1..=HORIZON).map(|step| nearness(step as usize)).sum::<f64>() / f64::from(steps);
    let survival = |satellite: usize| case.trace.satellite(satellite, HORIZON).survival;
    let least = satellites.iter().copied().min_by(|&a, &b| survival(a).total_cmp(&survival(b)))?;
    (held >= GOAL && survival(least) < 1.0).then(|| Failure {
        mode: Mode::Risk.name(),
        agent: least as u32,
        step: HORIZON,
        encounter: None,
        measures: vec![
            Measure { name: "survival", value: survival(least), unit: "" },
            Measure { name: "held", value: held, unit: "" },
            Measure { name: "goal", value: goal, unit: "" },
        ],
        words: format!(
            "The goal was held, {held:.3} over the last {steps} steps, but encounters left satellite {least} a survival of \
             {:.3}: together {goal:.3}.",
            survival(least)
        ),
    })
}

/// It was there and did not stay.
fn overshoot(bodies: &[Body], goal: f64, first: usize, left: usize) -> Failure {
    let body = &bodies[first];
    let ((rx, ry), _) = body.frame();
    let climb = body.vx * rx + body.vy * ry;
    let after = || bodies[first..].iter().map(Body::radius);
    let (highest, lowest) = (after().fold(0.0, f64::max), after().fold(f64::MAX, f64::min));
    Failure {
        mode: Mode::Overshoot.name(),
        agent: 0,
        step: left as u32,
        encounter: None,
        measures: vec![
            Measure { name: "arrived_step", value: first as f64, unit: "step" },
            Measure { name: "radial_speed", value: climb, unit: "LU/TU" },
            Measure { name: "highest_radius", value: highest, unit: "LU" },
            Measure { name: "lowest_radius", value: lowest, unit: "LU" },
            Measure { name: "goal", value: goal, unit: "" },
        ],
        words: format!(
            "Satellite 0 reached radius {TARGET_RADIUS:.0} at step {first} at a radial speed of {climb:.1} LU/TU and left it again \
             at step {left}, between {lowest:.1} and {highest:.1} LU: mean proximity {goal:.2} over the last {RENDEZVOUS_STEPS} steps."
        ),
    }
}

/// It never was there, or too late.
fn short(bodies: &[Body], goal: f64, arrived: Option<usize>) -> Failure {
    let near = |step: &usize| (bodies[*step].radius() - TARGET_RADIUS).abs();
    let closest = (0..bodies.len()).min_by(|a, b| near(a).total_cmp(&near(b))).unwrap_or(0);
    let radius = bodies[closest].radius();
    let step = arrived.unwrap_or(closest);
    let came = match arrived {
        Some(step) => format!("reached radius {TARGET_RADIUS:.0} only at step {step}"),
        None => format!(
            "never came within {BAND:.0} LU of radius {TARGET_RADIUS:.0}: nearest was {radius:.1} LU at step {closest}"
        ),
    };
    Failure {
        mode: Mode::Short.name(),
        agent: 0,
        step: step.max(1) as u32,
        encounter: None,
        measures: vec![
            Measure { name: "nearest_radius", value: radius, unit: "LU" },
            Measure { name: "goal", value: goal, unit: "" },
        ],
        words: format!(
            "Satellite 0 {came}; mean proximity {goal:.2} over the last {RENDEZVOUS_STEPS} steps."
        ),
    }
}
