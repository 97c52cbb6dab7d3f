//! What a deputy's thrusts were worth. Episodes have hundreds of seconds of thrust, and a second of it alone changes
//! nothing that counts: so what is judged are arcs. The flight of each deputy is cut into at most six windows of equal
//! length, not below 30 s, the last as long as what remains; the thrust of a window is one arc, and its counterfactual
//! is the same flight without it.

use super::flown::Course;
use crate::critique::{ActionVerdict, Verdict};
use crate::docking::constants::{COLLISION_DISTANCE_M, FAILURE, STATE, STEP_S};
use crate::docking::flight::Status;
use crate::docking::relative::{State, Step, Transition, distance, separation};
use crate::docking::reward::{approach, delta_v, nearness};

/// Windows a flight is cut into at most.
const WINDOWS: u32 = 6;
/// Shortest window, steps.
const SHORTEST: u32 = 30;
/// Seconds a counterfactual coasts on by the rules after the deputy left in truth.
const COAST: u32 = 60;
/// A deputy's return that counts.
const COUNTS: f64 = 0.05;

/// One verdict an arc, in order of step.
pub(super) fn of(course: &Course) -> Vec<ActionVerdict> {
    let mut verdicts = Vec::new();
    for deputy in 0..course.count() {
        let left = course.left(deputy);
        let length = left.div_ceil(WINDOWS).max(SHORTEST);
        let mut from = 1;
        while from <= left {
            let to = (from + length - 1).min(left);
            let mut cost = 0.0;
            let mut first = None;
            for step in from..=to {
                let change = delta_v(course.thrust(deputy, step));
                if change > 0.0 {
                    first = first.or(Some(step));
                    cost += change;
                }
            }
            if let Some(step) = first {
                verdicts.push(judge(course, deputy, step, to, cost));
            }
            from = to + 1;
        }
    }
    verdicts.sort_by_key(|verdict| (verdict.step, verdict.agent));
    verdicts
}

fn judge(course: &Course, deputy: usize, from: u32, to: u32, cost: f64) -> ActionVerdict {
    let with = course.deputy(deputy, course.left(deputy)).earned;
    let status = course.flight.status(deputy);
    let (without, status_without) = without(course, deputy, from, to);
    let gain = with - without;
    let verdict = match (status == Status::Docked, status_without == Status::Docked) {
        (true, false) => Verdict::Needed,
        (false, true) => Verdict::Harmful,
        _ if status == Status::Collided && status_without != Status::Collided => Verdict::Harmful,
        _ if gain >= COUNTS => Verdict::Needed,
        _ if gain <= -COUNTS => Verdict::Harmful,
        _ if gain < 0.0 => Verdict::Wasteful,
        _ => Verdict::Harmless,
    };
    ActionVerdict {
        step: from,
        agent: deputy as u32,
        cost,
        verdict,
        // The score is the mean of the returns. Only its own is compared: of what the others would have done had they not
        // collided with it nothing is known.
        gain: gain / course.count() as f64,
    }
}

/// What the deputy would have earned without its thrust in these steps, the others as they flew, and how it would have
/// ended. If it still flew when in truth it left, it coasts: a minute by the rules, then until time runs out or two others
/// collide, and then only where it ends counts, and nothing that it might meet on the way.
fn without(course: &Course, deputy: usize, from: u32, to: u32) -> (f64, Status) {
    let setup = course.flight.setup();
    // Two others that collide end every flight, whatever this deputy does.
    let others_collide =
        course.pairs().any(|pair| pair.0 != deputy && pair.1 != deputy).then(|| course.flight.steps());
    // Its own collision ended everybody's flight too: nothing is known after it.
    let collided = course.flight.status(deputy) == Status::Collided;
    let end = others_collide.unwrap_or(setup.time_limit);
    let last = end.min(course.left(deputy) + if collided { 0 } else { COAST });
    let mut flown = *course.deputy(deputy, from - 1);
    for step in from..=last {
        let thrust = if step <= to { [0.0; 3] } else { course.thrust(deputy, step) };
        flown.fly(Step::one(), setup, step, thrust);
        if flown.flies() && (others_collide == Some(step) || meets(course, deputy, step, &flown.state)) {
            flown.ends.collision = true;
        }
        if !flown.flies() {
            return (flown.earned, flown.ends.status());
        }
    }
    if collided {
        return (flown.earned, Status::Active);
    }
    let drifted = Transition::over(f64::from(end - last) * STEP_S).phi
        * nalgebra::SVector::<f64, STATE>::from(flown.state);
    let earned = flown.earned + approach(flown.nearness, nearness(distance(&drifted.into())));
    match others_collide {
        Some(_) => (earned, Status::Collided),
        None => (earned + FAILURE, Status::TimedOut),
    }
}

/// Whether the deputy there and then is too close to another that flew on.
fn meets(course: &Course, deputy: usize, step: u32, state: &State) -> bool {
    (0..course.count()).any(|other| {
        let flies = course.left(other) > step
            || (course.left(other) == step && course.flight.status(other) == Status::Collided);
        other != deputy && flies && separation(state, course.state(other, step)) < COLLISION_DISTANCE_M
    })
}
