//! Rendezvous goal: satellite 0 survives, but does not hold radius 100 LU long enough.

use super::analysis::EpisodeAnalysis;
use super::failure_mode::KesslerFailureMode;
use crate::critique::{Failure, Measure};
use crate::kessler::constants::{GOAL_THRESHOLD, HORIZON, PROXIMITY_WIDTH, RENDEZVOUS_STEPS, TARGET_RADIUS};
use crate::kessler::kernel::Body;
use crate::kessler::reward::{Objective, proximity};

/// Deviation from the target radius up to which proximity is at least [`GOAL_THRESHOLD`], LU.
const GOAL_BAND: f64 = PROXIMITY_WIDTH * (1.0 - GOAL_THRESHOLD);

/// Finds the failure of a missed rendezvous goal. A goal that was missed through the loss of satellite 0 has
/// none.
pub(super) fn find(analysis: &EpisodeAnalysis<'_>) -> Option<Failure> {
    let goal = analysis.outcome().goal.filter(|&goal| goal < GOAL_THRESHOLD)?;
    if analysis.objective != Objective::Rendezvous || analysis.trace.losses[0].is_some() {
        return None;
    }
    let bodies: Vec<Body> = (0..=HORIZON).map(|step| analysis.trace.satellite(0, step).body).collect();
    if let Some(failure) = risk_failure(analysis, goal, &[0], |step| proximity(bodies[step].radius())) {
        return Some(failure);
    }
    let deviation = |step: usize| (bodies[step].radius() - TARGET_RADIUS).abs();
    let has_crossed =
        |step: usize| (bodies[step - 1].radius() < TARGET_RADIUS) != (bodies[step].radius() < TARGET_RADIUS);
    let last = HORIZON as usize;
    let arrived = (1..=last).find(|&step| deviation(step) <= GOAL_BAND || has_crossed(step));
    let left = arrived.and_then(|first| (first..=last).find(|&step| deviation(step) > GOAL_BAND));
    Some(match (arrived, left) {
        (Some(arrived), Some(left)) => overshoot_failure(&bodies, goal, arrived, left),
        _ => short_failure(&bodies, goal, arrived),
    })
}

/// Failure under `risk: pc` if the goal was held, but the survival of one of these satellites was too low.
/// `quality` is the goal's value after a step regardless of survival.
pub(super) fn risk_failure(
    analysis: &EpisodeAnalysis<'_>,
    goal: f64,
    satellites: &[usize],
    quality: impl Fn(usize) -> f64,
) -> Option<Failure> {
    let steps = analysis.objective.goal_steps();
    let last_steps = HORIZON - steps + 1..=HORIZON;
    let held = last_steps.map(|step| quality(step as usize)).sum::<f64>() / f64::from(steps);
    let survival = |satellite: usize| analysis.trace.satellite(satellite, HORIZON).survival;
    let least = satellites.iter().copied().min_by(|&a, &b| survival(a).total_cmp(&survival(b)))?;
    (held >= GOAL_THRESHOLD && survival(least) < 1.0).then(|| Failure {
        mode: KesslerFailureMode::Risk.name(),
        agent: least as u32,
        step: HORIZON,
        encounter: None,
        orbit_angle_deg: None,
        measures: vec![
            Measure::new("survival", survival(least), ""),
            Measure::new("held", held, ""),
            Measure::new("goal", goal, ""),
        ],
        explanation: format!(
            "The goal was held at {held:.3} over the last {steps} steps, but close approaches left satellite {least} with \
             survival {:.3}: {goal:.3} in total.",
            survival(least)
        ),
    })
}

/// Failure of a satellite that reached the target radius and did not stay.
fn overshoot_failure(bodies: &[Body], goal: f64, arrived: usize, left: usize) -> Failure {
    let body = &bodies[arrived];
    let ((rx, ry), _) = body.local_axes();
    let radial_speed = body.vx * rx + body.vy * ry;
    let radii = || bodies[arrived..].iter().map(Body::radius);
    let (highest, lowest) = (radii().fold(0.0, f64::max), radii().fold(f64::MAX, f64::min));
    Failure {
        mode: KesslerFailureMode::Overshoot.name(),
        agent: 0,
        step: left as u32,
        encounter: None,
        orbit_angle_deg: None,
        measures: vec![
            Measure::new("arrived_step", arrived as f64, "step"),
            Measure::new("radial_speed", radial_speed, "LU/TU"),
            Measure::new("highest_radius", highest, "LU"),
            Measure::new("lowest_radius", lowest, "LU"),
            Measure::new("goal", goal, ""),
        ],
        explanation: format!(
            "Satellite 0 reached radius {TARGET_RADIUS:.0} at step {arrived} at a radial speed of {radial_speed:.1} LU/TU \
             and left it again at step {left}, between {lowest:.1} and {highest:.1} LU: mean proximity {goal:.2} over the \
             last {RENDEZVOUS_STEPS} steps."
        ),
    }
}

/// Failure of a satellite that never reached the target radius, or too late.
fn short_failure(bodies: &[Body], goal: f64, arrived: Option<usize>) -> Failure {
    let deviation = |step: &usize| (bodies[*step].radius() - TARGET_RADIUS).abs();
    let by_deviation = |a: &usize, b: &usize| deviation(a).total_cmp(&deviation(b));
    let nearest = (0..bodies.len()).min_by(by_deviation).unwrap_or(0);
    let radius = bodies[nearest].radius();
    let step = arrived.unwrap_or(nearest);
    let progress = match arrived {
        Some(step) => format!("reached radius {TARGET_RADIUS:.0} only at step {step}"),
        None => format!(
            "never came within {GOAL_BAND:.0} LU of radius {TARGET_RADIUS:.0}: nearest was {radius:.1} LU at step {nearest}"
        ),
    };
    Failure {
        mode: KesslerFailureMode::Short.name(),
        agent: 0,
        step: step.max(1) as u32,
        encounter: None,
        orbit_angle_deg: None,
        measures: vec![Measure::new("nearest_radius", radius, "LU"), Measure::new("goal", goal, "")],
        explanation: format!(
            "Satellite 0 {progress}; mean proximity {goal:.2} over the last {RENDEZVOUS_STEPS} steps."
        ),
    }
}
