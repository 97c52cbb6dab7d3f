//! Formation: everybody lives and the triangle does not hold.

use super::Case;
use super::mode::Mode;
use crate::critique::{Failure, Measure};
use crate::kessler::constants::{GOAL, HORIZON, SATELLITES};
use crate::kessler::kernel::{Body, distance_2};
use crate::kessler::reward::Objective;

/// Side of the triangle, LU, and the deviation at which a pair is worth nothing.
const SIDE: f64 = 20.0;
const PAIRS: [(usize, usize); SATELLITES] = [(0, 1), (0, 2), (1, 2)];

type Bodies = [Body; SATELLITES];

/// Why the goal was missed. Where somebody was lost, that is why.
pub(super) fn broken(case: &Case<'_>) -> Option<Failure> {
    let flown = case.flown();
    let formation =
        !matches!(case.objective, Objective::Survival | Objective::EcoStation | Objective::Rendezvous);
    let goal = flown.goal.filter(|&goal| formation && goal < GOAL && flown.lost == 0)?;
    let at = |step| std::array::from_fn(|i| case.trace.satellite(i, step).body);
    let bodies: Vec<Bodies> = (0..=HORIZON).map(at).collect();
    Some(break_up(&bodies, goal))
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
    let pair = PAIRS.into_iter().min_by(|&a, &b| kept(now, a).total_cmp(&kept(now, b))).unwrap_or(PAIRS[0]);
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
             not {SIDE:.0}; mean form {goal:.2} over the last steps."
        ),
    }
}

/// Mean over the pairs.
fn form(bodies: &Bodies) -> f64 {
    PAIRS.iter().map(|&pair| kept(bodies, pair)).sum::<f64>() / PAIRS.len() as f64
}

/// How well a pair keeps its distance: max(0, 1 − |d − 20|/20).
fn kept(bodies: &Bodies, pair: (usize, usize)) -> f64 {
    (1.0 - (distance(bodies, pair) - SIDE).abs() / SIDE).max(0.0)
}

fn distance(bodies: &Bodies, (a, b): (usize, usize)) -> f64 {
    distance_2(bodies[a].x, bodies[a].y, bodies[b].x, bodies[b].y).sqrt()
}
