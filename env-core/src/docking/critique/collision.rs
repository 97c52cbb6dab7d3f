//! Two deputies that met: from where, how fast, and the cheapest thrust that would have kept them apart.

use super::failures::measure;
use super::flown::Course;
use crate::critique::{BEARING_STEPS, Encounter, Failure, Remedy, angle_deg};
use crate::docking::constants::COLLISION_DISTANCE_M;
use crate::docking::relative::{State, Step, distance, relative_speed, separation};
use crate::docking::reward::delta_v;

/// How long before the contact a thrust is tried, s.
const BEFORE: [u32; 7] = [60, 30, 15, 8, 4, 2, 1];
/// Its sizes over the bound.
const SIZES: [f64; 3] = [0.1, 0.3, 1.0];
/// The two must stay apart for this long after the contact too, coasting, s.
const AFTER: u32 = 10;

/// The failure of a deputy that left by a collision: its own, or that of two others, which ended the episode.
pub(super) fn failure(course: &Course, deputy: usize) -> Failure {
    let step = course.left(deputy);
    let other = course.pairs().find_map(|(first, second)| match deputy {
        d if d == first => Some(second),
        d if d == second => Some(first),
        _ => None,
    });
    match other {
        Some(other) => met(course, deputy, other, step),
        None => Failure {
            mode: "collision",
            agent: deputy as u32,
            step,
            encounter: None,
            measures: vec![measure("distance", distance(course.state(deputy, step)), "m")],
            words: format!("Deputy {deputy} was still flying when two others collided at step {step}."),
        },
    }
}

fn met(course: &Course, deputy: usize, other: usize, step: u32) -> Failure {
    let (mine, theirs) = (course.state(deputy, step), course.state(other, step));
    let (apart, relative) = (separation(mine, theirs), relative_speed(mine, theirs));
    let before = step - BEARING_STEPS.min(step);
    let (from, to) = (course.state(deputy, before), course.state(other, before));
    let bearing_deg = angle_deg(to[0] - from[0], to[1] - from[1]);
    let away = distance(mine);
    let cheapest = cheapest(course, deputy, other, step);
    let remedy = cheapest.as_ref().map_or_else(
        || "no single thrust of it that was tried would have kept them apart".to_owned(),
        |remedy| format!("one second of thrust at step {} would have kept them apart", remedy.step),
    );
    Failure {
        mode: "collision",
        agent: deputy as u32,
        step,
        measures: vec![
            measure("separation", apart, "m"),
            measure("relative_speed", relative, "m/s"),
            measure("distance", away, "m"),
        ],
        words: format!(
            "Deputy {deputy} met deputy {other} at step {step}, {away:.1} m from the chief, at {relative:.3} m/s from \
             bearing {bearing_deg:.0}°; {remedy}."
        ),
        encounter: Some(Encounter {
            body: other as u32,
            bearing_deg,
            bearing_inertial_deg: None,
            relative_speed: relative,
            first_visible_step: Some(0),
            steps_left: step,
            avoidable: Some(cheapest.is_some()),
            cheapest,
        }),
    }
}

/// The cheapest extra second of thrust along one axis that keeps the two apart until some time after the contact. Motion
/// is linear, so an extra thrust adds its own response to what was flown.
fn cheapest(course: &Course, deputy: usize, other: usize, contact: u32) -> Option<Remedy> {
    let bound = course.flight.setup().thrust_bound;
    let relative = relative_path(course, deputy, other, contact);
    let mut best: Option<Remedy> = None;
    for before in BEFORE.into_iter().filter(|&before| before <= contact) {
        let step = contact + 1 - before;
        let flown = course.thrust(deputy, step);
        for (axis, sign, size) in (0..3)
            .flat_map(|axis| [-1.0, 1.0].map(|sign| (axis, sign)))
            .flat_map(|(axis, sign)| SIZES.map(|size| (axis, sign, size)))
        {
            let mut values = flown;
            values[axis] = (flown[axis] + sign * size * bound).clamp(-bound, bound);
            let extra: [f64; 3] = std::array::from_fn(|i| values[i] - flown[i]);
            let cost = delta_v(extra);
            let cheaper = best.as_ref().is_none_or(|best| cost < best.cost);
            if cost > 0.0 && cheaper && stays_apart(&relative, step, extra) {
                best = Some(Remedy { step, values: values.to_vec(), cost });
            }
        }
    }
    best
}

/// The deputy less the other, from the longest time tried before the contact on: (step, relative state).
fn relative_path(course: &Course, deputy: usize, other: usize, contact: u32) -> Vec<(u32, State)> {
    let first = contact - BEFORE[0].min(contact);
    let less = |step: u32| {
        let (a, b) = (course.state(deputy, step), course.state(other, step));
        std::array::from_fn(|i| a[i] - b[i])
    };
    let mut path: Vec<(u32, State)> = (first..=contact).map(|step| (step, less(step))).collect();
    let mut last = less(contact);
    for step in contact + 1..=contact + AFTER {
        last = Step::one().advance(&last, [0.0; 3]);
        path.push((step, last));
    }
    path
}

fn stays_apart(relative: &[(u32, State)], step: u32, extra: [f64; 3]) -> bool {
    let mut response: State = [0.0; 6];
    relative.iter().filter(|(at, _)| *at >= step).all(|(at, flown)| {
        let thrust = if *at == step { extra } else { [0.0; 3] };
        response = Step::one().advance(&response, thrust);
        let moved: State = std::array::from_fn(|i| flown[i] + response[i]);
        distance(&moved) >= COLLISION_DISTANCE_M
    })
}
