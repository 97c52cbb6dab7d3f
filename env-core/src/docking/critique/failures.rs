//! Why each deputy that did not dock was lost, with the numbers that belong to it.

use super::collision;
use super::flown::Course;
use crate::critique::{BEARING_STEPS, Encounter, Failure, Measure, angle_deg};
use crate::docking::approach::Approach;
use crate::docking::constants::{DOCKING_RADIUS_M, DOCKING_SPEED_M_S, LIMIT_SLOPE_1_S, MASS_KG};
use crate::docking::flight::Status;
use crate::docking::planner::solo::Solo;
use crate::docking::relative::{State, distance, limit_line, speed, speed_limit};

/// How long before a crash braking is tried, s.
const BRAKE_BEFORE: [u32; 9] = [1, 2, 4, 8, 16, 32, 64, 128, 256];

/// All of them, in order of step.
pub(super) fn of(course: &Course) -> Vec<Failure> {
    let mut failures: Vec<Failure> = (0..course.count())
        .filter_map(|deputy| match course.flight.status(deputy) {
            Status::Active | Status::Docked => None,
            Status::Crashed => Some(crash(course, deputy)),
            Status::Saturated => Some(saturation(course, deputy)),
            Status::OutOfBounds => Some(out_of_bounds(course, deputy)),
            Status::Collided => Some(collision::failure(course, deputy)),
            Status::TimedOut => Some(timeout(course, deputy)),
        })
        .collect();
    failures.sort_by_key(|failure| (failure.step, failure.agent));
    failures
}

/// A measure.
pub(super) const fn measure(name: &'static str, value: f64, unit: &'static str) -> Measure {
    Measure { name, value, unit }
}

/// Speed towards the chief, and across, m/s.
fn split(state: &State) -> (f64, f64) {
    let d = distance(state).max(f64::MIN_POSITIVE);
    let closing = -(state[0] * state[3] + state[1] * state[4] + state[2] * state[5]) / d;
    let v = speed(state);
    (closing, (v * v - closing * closing).max(0.0).sqrt())
}

fn crash(course: &Course, deputy: usize) -> Failure {
    let step = course.left(deputy);
    let state = course.state(deputy, step);
    let (d, v, (closing, across)) = (distance(state), speed(state), split(state));
    let limit = speed_limit(d);
    let last_chance = last_chance(course, deputy);
    let mut measures = vec![
        measure("speed", v, "m/s"),
        measure("speed_limit", limit, "m/s"),
        measure("closing_speed", closing, "m/s"),
        measure("lateral_speed", across, "m/s"),
        measure("distance", d, "m"),
        measure("x", state[0], "m"),
        measure("y", state[1], "m"),
        measure("z", state[2], "m"),
        measure("time_over_limit", over_limit(course, deputy).seconds, "s"),
    ];
    measures.extend(last_chance.map(|seconds| measure("last_chance", f64::from(seconds), "s")));
    // The chief, seen from the deputy, from radial out (+x) towards in-track (+y).
    let seen = course.state(deputy, step - BEARING_STEPS.min(step));
    let bearing_deg = angle_deg(-seen[0], -seen[1]);
    let brake = match last_chance {
        Some(seconds) => format!("braking {seconds} s before would have docked it"),
        None => "no braking tried would have docked it".to_owned(),
    };
    Failure {
        mode: "crash",
        agent: deputy as u32,
        step,
        words: format!(
            "Deputy {deputy} met the chief at {v:.3} m/s, {:.3} m/s above the limit, at step {step}; the chief was at \
             bearing {bearing_deg:.0}°, and {brake}.",
            v - limit
        ),
        encounter: Some(Encounter {
            body: 0,
            bearing_deg,
            bearing_inertial_deg: None,
            relative_speed: v,
            first_visible_step: Some(0),
            steps_left: step,
            avoidable: Some(last_chance.is_some()),
            cheapest: None,
        }),
        measures,
    }
}

/// The one braking that is tried: full authority, down to 0.18 m/s at the docking radius.
fn braking(bound: f64) -> Approach {
    Approach {
        fraction: 0.9,
        gain: MASS_KG,
        brake_distance: 0.8,
        final_speed: 0.18,
        brake_slope: 0.36,
        lateral: 1.0,
        deceleration: 0.75 * bound / MASS_KG,
    }
}

/// The shortest time before the crash, of those tried, at which flying by the law would still have docked it, by itself, in
/// the time and with the velocity penalty that it had left then.
fn last_chance(course: &Course, deputy: usize) -> Option<u32> {
    let setup = course.flight.setup();
    let crashed = course.left(deputy);
    let before = BRAKE_BEFORE.into_iter().take_while(|seconds| *seconds < crashed).chain([crashed]);
    before.into_iter().find(|seconds| {
        let step = crashed - seconds;
        Solo::fly(setup, *course.deputy(deputy, step), step, braking(setup.thrust_bound)).docked
    })
}

/// How a deputy broke the speed limit.
struct Over {
    seconds: f64,
    first: u32,
    worst: f64,
}

fn over_limit(course: &Course, deputy: usize) -> Over {
    let mut over = Over { seconds: 0.0, first: 0, worst: 0.0 };
    for step in 1..=course.left(deputy) {
        let state = course.state(deputy, step);
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

fn saturation(course: &Course, deputy: usize) -> Failure {
    let step = course.left(deputy);
    let state = course.state(deputy, step);
    let (d, over) = (distance(state), over_limit(course, deputy));
    let penalty = course.deputy(deputy, step).velocity_sum;
    Failure {
        mode: "saturation",
        agent: deputy as u32,
        step,
        encounter: None,
        measures: vec![
            measure("time_over_limit", over.seconds, "s"),
            measure("first_violation_step", f64::from(over.first), "s"),
            measure("worst_excess", over.worst, "m/s"),
            measure("penalty", penalty, ""),
            measure("speed", speed(state), "m/s"),
            measure("distance", d, "m"),
        ],
        words: format!(
            "Deputy {deputy} flew above the speed limit for {:.0} s from step {} on, by up to {:.2} m/s, and was \
             stopped at step {step}, {d:.0} m from the chief.",
            over.seconds, over.first, over.worst
        ),
    }
}

/// The closest a deputy came, m, and when.
fn closest(course: &Course, deputy: usize) -> (f64, u32) {
    (0..=course.left(deputy))
        .map(|step| (distance(course.state(deputy, step)), step))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap_or((0.0, 0))
}

fn out_of_bounds(course: &Course, deputy: usize) -> Failure {
    let step = course.left(deputy);
    let state = course.state(deputy, step);
    let (d, v, (near, when)) = (distance(state), speed(state), closest(course, deputy));
    Failure {
        mode: "out_of_bounds",
        agent: deputy as u32,
        step,
        encounter: None,
        measures: vec![
            measure("distance", d, "m"),
            measure("speed", v, "m/s"),
            measure("bearing", angle_deg(state[0], state[1]), "°"),
            measure("closest_distance", near, "m"),
            measure("closest_step", f64::from(when), "s"),
        ],
        words: format!(
            "Deputy {deputy} was {d:.0} m from the chief at step {step}, flying at {v:.2} m/s; the closest it came was \
             {near:.1} m at step {when}."
        ),
    }
}

/// Time that flying in at the speed limit takes from a distance, s: ∫ dd/(0.2 + 2n(d − 0.5)).
fn time_needed(distance: f64) -> f64 {
    let ratio = limit_line(distance.max(DOCKING_RADIUS_M)) / DOCKING_SPEED_M_S;
    libm::log(ratio) / LIMIT_SLOPE_1_S
}

fn timeout(course: &Course, deputy: usize) -> Failure {
    let step = course.left(deputy);
    let state = course.state(deputy, step);
    let (d, (closing, _), (near, when)) = (distance(state), split(state), closest(course, deputy));
    let needed = time_needed(d);
    Failure {
        mode: "timeout",
        agent: deputy as u32,
        step,
        encounter: None,
        measures: vec![
            measure("distance", d, "m"),
            measure("closing_speed", closing, "m/s"),
            measure("time_needed", needed, "s"),
            measure("closest_distance", near, "m"),
            measure("closest_step", f64::from(when), "s"),
        ],
        words: format!(
            "Deputy {deputy} was {d:.1} m from the chief when time ran out at step {step}, {needed:.0} s away at the \
             speed limit; the closest it came was {near:.1} m at step {when}."
        ),
    }
}
