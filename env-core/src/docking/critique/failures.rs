//! The failure of each deputy that did not dock, with its measures.

use super::collision;
use super::trajectory::DockingTrajectory;
use crate::critique::{BEARING_STEPS, Encounter, Failure, Measure, angle_deg};
use crate::docking::approach_law::ApproachLaw;
use crate::docking::constants::{DOCKING_RADIUS_M, DOCKING_SPEED_M_S, LIMIT_SLOPE_1_S, MASS_KG};
use crate::docking::end_conditions::DeputyStatus;
use crate::docking::planner::solo_plan::SoloPlan;
use crate::docking::relative_motion::{RelativeState, distance, extended_speed_limit, speed, speed_limit};

/// Times before a crash at which braking is tried, s.
const BRAKE_BEFORE: [u32; 9] = [1, 2, 4, 8, 16, 32, 64, 128, 256];

/// The failures in order of step.
pub(super) fn find_failures(trajectory: &DockingTrajectory) -> Vec<Failure> {
    let mut failures: Vec<Failure> = (0..trajectory.deputy_count())
        .filter_map(|deputy| match trajectory.sim.status(deputy) {
            DeputyStatus::Active | DeputyStatus::Docked => None,
            DeputyStatus::Crashed => Some(crash(trajectory, deputy)),
            DeputyStatus::Saturated => Some(saturation(trajectory, deputy)),
            DeputyStatus::OutOfBounds => Some(out_of_bounds(trajectory, deputy)),
            DeputyStatus::Collided => Some(collision::collision_failure(trajectory, deputy)),
            DeputyStatus::TimedOut => Some(timeout(trajectory, deputy)),
        })
        .collect();
    failures.sort_by_key(|failure| (failure.step, failure.agent));
    failures
}

/// Velocity of a deputy, by components relative to the line to the chief.
struct ApproachSpeed {
    /// Speed towards the chief, m/s.
    closing: f64,
    /// Speed across the line to the chief, m/s.
    lateral: f64,
}

fn approach_speed(state: &RelativeState) -> ApproachSpeed {
    let d = distance(state).max(f64::MIN_POSITIVE);
    let closing = -(state[0] * state[3] + state[1] * state[4] + state[2] * state[5]) / d;
    let v = speed(state);
    ApproachSpeed { closing, lateral: (v * v - closing * closing).max(0.0).sqrt() }
}

fn crash(trajectory: &DockingTrajectory, deputy: usize) -> Failure {
    let step = trajectory.last_step(deputy);
    let state = trajectory.state(deputy, step);
    let (d, v, approach) = (distance(state), speed(state), approach_speed(state));
    let limit = speed_limit(d);
    let last_chance = last_chance(trajectory, deputy);
    let mut measures = vec![
        Measure::new("speed", v, "m/s"),
        Measure::new("speed_limit", limit, "m/s"),
        Measure::new("closing_speed", approach.closing, "m/s"),
        Measure::new("lateral_speed", approach.lateral, "m/s"),
        Measure::new("distance", d, "m"),
        Measure::new("x", state[0], "m"),
        Measure::new("y", state[1], "m"),
        Measure::new("z", state[2], "m"),
        Measure::new("time_over_limit", limit_violation(trajectory, deputy).seconds, "s"),
    ];
    measures.extend(last_chance.map(|seconds| Measure::new("last_chance", f64::from(seconds), "s")));
    // Bearing of the chief as seen from the deputy, from radial out (+x) towards in-track (+y).
    let before = trajectory.state(deputy, step - BEARING_STEPS.min(step));
    let bearing_deg = angle_deg(-before[0], -before[1]);
    let brake = match last_chance {
        Some(seconds) => format!("braking {seconds} s before would have docked it"),
        None => "no braking tried would have docked it".to_owned(),
    };
    Failure {
        mode: "crash",
        agent: deputy as u32,
        step,
        explanation: format!(
            "Deputy {deputy} met the chief at {v:.3} m/s, {:.3} m/s above the limit, at step {step}; the chief was at \
             bearing {bearing_deg:.0}°, and {brake}.",
            v - limit
        ),
        orbit_angle_deg: None,
        encounter: Some(Encounter {
            body: 0,
            bearing_deg,
            bearing_inertial_deg: None,
            relative_speed: v,
            first_visible_step: Some(0),
            steps_left: step,
            avoidable: Some(last_chance.is_some()),
            cheapest_avoidance: None,
        }),
        measures,
    }
}

/// The braking that is tried: full thrust, down to 0.18 m/s at the docking radius.
fn braking(bound: f64) -> ApproachLaw {
    ApproachLaw {
        speed_fraction: 0.9,
        gain: MASS_KG,
        brake_distance: 0.8,
        final_speed: 0.18,
        brake_slope: 0.36,
        lateral_ratio: 1.0,
        deceleration: 0.75 * bound / MASS_KG,
    }
}

/// The shortest tried time before the crash at which braking would still have docked the deputy by itself, with the time
/// and velocity penalty that it had left. `None` if no tried time would.
fn last_chance(trajectory: &DockingTrajectory, deputy: usize) -> Option<u32> {
    let setup = trajectory.sim.setup();
    let crashed = trajectory.last_step(deputy);
    let before = BRAKE_BEFORE.into_iter().take_while(|seconds| *seconds < crashed).chain([crashed]);
    before.into_iter().find(|seconds| {
        let step = crashed - seconds;
        SoloPlan::simulate(setup, *trajectory.deputy(deputy, step), step, braking(setup.thrust_bound)).docked
    })
}

/// Violation of the speed limit over a trajectory.
struct LimitViolation {
    /// Time above the limit, s.
    seconds: f64,
    /// First step above the limit; 0 if none.
    first: u32,
    /// Largest speed above the limit, m/s.
    worst: f64,
}

fn limit_violation(trajectory: &DockingTrajectory, deputy: usize) -> LimitViolation {
    let mut over = LimitViolation { seconds: 0.0, first: 0, worst: 0.0 };
    for step in 1..=trajectory.last_step(deputy) {
        let state = trajectory.state(deputy, step);
        let excess = speed(state) - speed_limit(distance(state));
        if excess > 0.0 {
            over.seconds += 1.0;
            over.worst = over.worst.max(excess);
            if over.first == 0 {
                over.first = step;
            }
        }
    }
    over
}

fn saturation(trajectory: &DockingTrajectory, deputy: usize) -> Failure {
    let step = trajectory.last_step(deputy);
    let state = trajectory.state(deputy, step);
    let (d, over) = (distance(state), limit_violation(trajectory, deputy));
    let penalty = trajectory.deputy(deputy, step).velocity_penalty;
    Failure {
        mode: "saturation",
        agent: deputy as u32,
        step,
        encounter: None,
        orbit_angle_deg: None,
        measures: vec![
            Measure::new("time_over_limit", over.seconds, "s"),
            Measure::new("first_violation_step", f64::from(over.first), "s"),
            Measure::new("worst_excess", over.worst, "m/s"),
            Measure::new("penalty", penalty, ""),
            Measure::new("speed", speed(state), "m/s"),
            Measure::new("distance", d, "m"),
        ],
        explanation: format!(
            "Deputy {deputy} flew above the speed limit for {:.0} s from step {} on, by up to {:.2} m/s, and was \
             stopped at step {step}, {d:.0} m from the chief.",
            over.seconds, over.first, over.worst
        ),
    }
}

/// Closest approach to the chief.
struct ClosestApproach {
    /// Smallest distance from the chief, m.
    distance: f64,
    step: u32,
}

fn closest_approach(trajectory: &DockingTrajectory, deputy: usize) -> ClosestApproach {
    (0..=trajectory.last_step(deputy))
        .map(|step| ClosestApproach { distance: distance(trajectory.state(deputy, step)), step })
        .min_by(|a, b| a.distance.total_cmp(&b.distance))
        .unwrap_or(ClosestApproach { distance: 0.0, step: 0 })
}

fn out_of_bounds(trajectory: &DockingTrajectory, deputy: usize) -> Failure {
    let step = trajectory.last_step(deputy);
    let state = trajectory.state(deputy, step);
    let (d, v) = (distance(state), speed(state));
    let ClosestApproach { distance: near, step: when } = closest_approach(trajectory, deputy);
    Failure {
        mode: "out_of_bounds",
        agent: deputy as u32,
        step,
        encounter: None,
        orbit_angle_deg: None,
        measures: vec![
            Measure::new("distance", d, "m"),
            Measure::new("speed", v, "m/s"),
            Measure::new("bearing", angle_deg(state[0], state[1]), "°"),
            Measure::new("closest_distance", near, "m"),
            Measure::new("closest_step", f64::from(when), "s"),
        ],
        explanation: format!(
            "Deputy {deputy} was {d:.0} m from the chief at step {step}, flying at {v:.2} m/s; the closest it came was \
             {near:.1} m at step {when}."
        ),
    }
}

/// Duration of an approach at the speed limit from a distance, s: ∫ dd/(0.2 + 2n(d − 0.5)).
fn time_needed(distance: f64) -> f64 {
    let ratio = extended_speed_limit(distance.max(DOCKING_RADIUS_M)) / DOCKING_SPEED_M_S;
    libm::log(ratio) / LIMIT_SLOPE_1_S
}

fn timeout(trajectory: &DockingTrajectory, deputy: usize) -> Failure {
    let step = trajectory.last_step(deputy);
    let state = trajectory.state(deputy, step);
    let (d, closing) = (distance(state), approach_speed(state).closing);
    let ClosestApproach { distance: near, step: when } = closest_approach(trajectory, deputy);
    let needed = time_needed(d);
    Failure {
        mode: "timeout",
        agent: deputy as u32,
        step,
        encounter: None,
        orbit_angle_deg: None,
        measures: vec![
            Measure::new("distance", d, "m"),
            Measure::new("closing_speed", closing, "m/s"),
            Measure::new("time_needed", needed, "s"),
            Measure::new("closest_distance", near, "m"),
            Measure::new("closest_step", f64::from(when), "s"),
        ],
        explanation: format!(
            "Deputy {deputy} was {d:.1} m from the chief when time ran out at step {step}, {needed:.0} s away at the \
             speed limit; the closest it came was {near:.1} m at step {when}."
        ),
    }
}
