//! Formation: everybody lives and the triangle does not hold.

use super::Case;
use super::goal::doubtful;
use super::mode::Mode;
use crate::critique::{Failure, Measure};
use crate::kessler::constants::{FORMATION_SIDE, GOAL, HORIZON, SATELLITES};
use crate::kessler::kernel::{Body, distance_2};
use crate::kessler::reward::{Objective, form};

const PAIRS: [(usize, usize); SATELLITES] = [(0, 1), (0, 2), (1, 2)];

type Bodies = [Body; SATELLITES];

/// Why the goal was missed. Where somebody was lost, that is why.
pub(super) fn broken(case: &Case<'_>) -> Option<Failure> {
    let flown = case.flown();
    let formation = case.objective == Objective::Formation;
    let goal = flown.goal.filter(|&goal| formation && goal < GOAL && flown.lost == 0)?;
    let at = |step| std::array::from_fn(|i| case.trace.satellite(i, step).body);
    let bodies: Vec<Bodies> = (0..=HORIZON).map(at).collect();
    let doubtful = doubtful(case, goal, &[0, 1, 2], |step| form(&bodies[step]));
    Some(doubtful.unwrap_or_else(|| break_up(&bodies, goal)))
}

/// When it broke for good, and which pair it was.
fn break_up(bodies: &[Bodies], goal: f64) -> Failure {
    let holds = |bodies: &Bodies| form(bodies) >= GOAL;
    // The step after the last that held; if the end held again, the worst of all.
    let last = bodies.len() - 1;
    let step = match bodies.iter().rposition(holds) {
        Some(held) if held < last => held + 1,
        Some(_) => (1..=last).min_by(|&a, &b| form(&bodies[a]).total_cmp(&form(&bodies[b]))).unwrap_or(last),
        None => 1,
    };
    let now = &bodies[step];
    let off = |pair| (distance(now, pair) - FORMATION_SIDE).abs();
    let pair = PAIRS.into_iter().max_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap_or(PAIRS[0]);
    let (there, end) = (distance(now, pair), distance(&bodies[last], pair));
    let (a, b) = pair;
    Failure {
        mode: Mode::BreakUp.name(),
        agent: a as u32,
        step: step as u32,
        encounter: None,
        measures: vec![
            Measure { name: "other", value: b as f64, unit: "" },
            Measure { name: "distance", value: there, unit: "LU" },
            Measure { name: "distance_at_end", value: end, unit: "LU" },
            Measure { name: "goal", value: goal, unit: "" },
        ],
        words: format!(
            "The formation was lost at step {step}: satellites {a} and {b} were {there:.1} LU apart, {end:.1} at the end, \
             not {FORMATION_SIDE:.0}; mean form {goal:.2} over the last steps."
        ),
    }
}

fn distance(bodies: &Bodies, (a, b): (usize, usize)) -> f64 {
    distance_2(bodies[a].x, bodies[a].y, bodies[b].x, bodies[b].y).sqrt()
}
