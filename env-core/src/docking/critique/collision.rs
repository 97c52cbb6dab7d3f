//! Collisions of two deputies: bearing, speed, and the cheapest thrust that would have prevented them.

use super::trajectory::DockingTrajectory;
use crate::critique::{BEARING_STEPS, Encounter, Failure, Measure, Remedy, angle_deg};
use crate::docking::constants::COLLISION_DISTANCE_M;
use crate::docking::relative_motion::{RelativeState, StepTransition, distance, relative_speed, separation};
use crate::docking::reward::thrust_delta_v;

/// Times before the contact at which a thrust is tried, s.
const REMEDY_LEADS_S: [u32; 7] = [60, 30, 15, 8, 4, 2, 1];
/// Tried thrusts divided by the thrust bound.
const REMEDY_SIZES: [f64; 3] = [0.1, 0.3, 1.0];
/// Duration after the contact for which the deputies must stay apart while coasting, s.
const CLEAR_STEPS: u32 = 10;

/// The failure of a deputy that left by its own collision, or by that of two others, which ended the episode.
pub(super) fn collision_failure(trajectory: &DockingTrajectory, deputy: usize) -> Failure {
    let step = trajectory.last_step(deputy);
    let other = trajectory.collided_pairs().find_map(|(first, second)| match deputy {
        d if d == first => Some(second),
        d if d == second => Some(first),
        _ => None,
    });
    match other {
        Some(other) => pair_failure(trajectory, deputy, other, step),
        None => Failure {
            mode: "collision",
            agent: deputy as u32,
            step,
            encounter: None,
            orbit_angle_deg: None,
            measures: vec![Measure::new("distance", distance(trajectory.state(deputy, step)), "m")],
            explanation: format!("Deputy {deputy} was still flying when two others collided at step {step}."),
        },
    }
}

fn pair_failure(trajectory: &DockingTrajectory, deputy: usize, other: usize, step: u32) -> Failure {
    let (mine, theirs) = (trajectory.state(deputy, step), trajectory.state(other, step));
    let (apart, relative) = (separation(mine, theirs), relative_speed(mine, theirs));
    let before = step - BEARING_STEPS.min(step);
    let (from, to) = (trajectory.state(deputy, before), trajectory.state(other, before));
    let bearing_deg = angle_deg(to[0] - from[0], to[1] - from[1]);
    let away = distance(mine);
    let cheapest_avoidance = cheapest_avoidance(trajectory, deputy, other, step);
    let remedy = cheapest_avoidance.as_ref().map_or_else(
        || "no single thrust of it that was tried would have kept them apart".to_owned(),
        |remedy| format!("one second of thrust at step {} would have kept them apart", remedy.step),
    );
    Failure {
        mode: "collision",
        agent: deputy as u32,
        step,
        measures: vec![
            Measure::new("separation", apart, "m"),
            Measure::new("relative_speed", relative, "m/s"),
            Measure::new("distance", away, "m"),
        ],
        explanation: format!(
            "Deputy {deputy} met deputy {other} at step {step}, {away:.1} m from the chief, at {relative:.3} m/s from \
             bearing {bearing_deg:.0}°; {remedy}."
        ),
        orbit_angle_deg: None,
        encounter: Some(Encounter {
            body: other as u32,
            bearing_deg,
            bearing_inertial_deg: None,
            relative_speed: relative,
            first_visible_step: Some(0),
            steps_left: step,
            avoidable: Some(cheapest_avoidance.is_some()),
            cheapest_avoidance,
        }),
    }
}

/// The cheapest additional second of thrust along one axis that keeps the two apart until [`CLEAR_STEPS`] after the
/// contact. Motion is linear, so an additional thrust adds its response to the recorded trajectory.
fn cheapest_avoidance(
    trajectory: &DockingTrajectory,
    deputy: usize,
    other: usize,
    contact: u32,
) -> Option<Remedy> {
    let bound = trajectory.sim.setup().thrust_bound;
    let relative = relative_path(trajectory, deputy, other, contact);
    let mut best: Option<Remedy> = None;
    for before in REMEDY_LEADS_S.into_iter().filter(|&before| before <= contact) {
        let step = contact + 1 - before;
        let recorded = trajectory.thrust(deputy, step);
        for (axis, sign, size) in (0..3)
            .flat_map(|axis| [-1.0, 1.0].map(|sign| (axis, sign)))
            .flat_map(|(axis, sign)| REMEDY_SIZES.map(|size| (axis, sign, size)))
        {
            let mut values = recorded;
            values[axis] = (recorded[axis] + sign * size * bound).clamp(-bound, bound);
            let extra: [f64; 3] = std::array::from_fn(|i| values[i] - recorded[i]);
            let cost = thrust_delta_v(extra);
            let cheaper = best.as_ref().is_none_or(|best| cost < best.cost);
            if cost > 0.0 && cheaper && stays_apart(&relative, step, extra) {
                best = Some(Remedy { step, values: values.to_vec(), cost });
            }
        }
    }
    best
}

/// States of the deputy relative to the other, from the longest lead before the contact to [`CLEAR_STEPS`] after it.
struct RelativePath {
    /// Step after which the first state holds; the others follow one by one.
    first_step: u32,
    states: Vec<RelativeState>,
}

fn relative_path(trajectory: &DockingTrajectory, deputy: usize, other: usize, contact: u32) -> RelativePath {
    let first_step = contact - REMEDY_LEADS_S[0].min(contact);
    let relative_state = |step: u32| {
        let (a, b) = (trajectory.state(deputy, step), trajectory.state(other, step));
        std::array::from_fn(|i| a[i] - b[i])
    };
    let mut states: Vec<RelativeState> = (first_step..=contact).map(relative_state).collect();
    let mut last = relative_state(contact);
    for _ in 0..CLEAR_STEPS {
        last = StepTransition::world_step().advance(&last, [0.0; 3]);
        states.push(last);
    }
    RelativePath { first_step, states }
}

/// True if an additional thrust in step `thrust_step` keeps the two apart on the rest of the path.
fn stays_apart(path: &RelativePath, thrust_step: u32, thrust: [f64; 3]) -> bool {
    let mut response: RelativeState = [0.0; 6];
    (path.first_step..).zip(&path.states).filter(|(step, _)| *step >= thrust_step).all(|(step, recorded)| {
        let thrust = if step == thrust_step { thrust } else { [0.0; 3] };
        response = StepTransition::world_step().advance(&response, thrust);
        let moved: RelativeState = std::array::from_fn(|i| recorded[i] + response[i]);
        distance(&moved) >= COLLISION_DISTANCE_M
    })
}
