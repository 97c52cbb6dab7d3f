//! Formation goal: all satellites survive, but the triangle does not hold.

use super::analysis::EpisodeAnalysis;
use super::failure_mode::KesslerFailureMode;
use super::rendezvous_goal::risk_failure;
use crate::critique::{Failure, Measure};
use crate::kessler::constants::{FORMATION_SIDE, GOAL_THRESHOLD, HORIZON, SATELLITES};
use crate::kessler::kernel::{Body, distance_squared};
use crate::kessler::reward::{Objective, formation_quality};

/// Pair of satellites, by their numbers.
#[derive(Debug, Clone, Copy)]
struct SatellitePair {
    first: usize,
    second: usize,
}

const PAIRS: [SatellitePair; SATELLITES] = [
    SatellitePair { first: 0, second: 1 },
    SatellitePair { first: 0, second: 2 },
    SatellitePair { first: 1, second: 2 },
];

type Bodies = [Body; SATELLITES];

/// Finds the failure of a missed formation goal. A goal that was missed through a loss has none.
pub(super) fn find(analysis: &EpisodeAnalysis<'_>) -> Option<Failure> {
    let outcome = analysis.outcome();
    let is_formation = analysis.objective == Objective::Formation;
    let goal = outcome.goal.filter(|&goal| is_formation && goal < GOAL_THRESHOLD && outcome.lost == 0)?;
    let bodies_after = |step| std::array::from_fn(|i| analysis.trace.satellite(i, step).body);
    let bodies: Vec<Bodies> = (0..=HORIZON).map(bodies_after).collect();
    let risk = risk_failure(analysis, goal, &[0, 1, 2], |step| formation_quality(&bodies[step]));
    Some(risk.unwrap_or_else(|| break_up_failure(&bodies, goal)))
}

/// Failure at the step from which the formation was lost, with the pair that deviates most.
fn break_up_failure(bodies: &[Bodies], goal: f64) -> Failure {
    let quality = |step: usize| formation_quality(&bodies[step]);
    let is_held = |bodies: &Bodies| formation_quality(bodies) >= GOAL_THRESHOLD;
    // The step after the last that held; the worst step if the formation held at the end.
    let last = bodies.len() - 1;
    let step = match bodies.iter().rposition(is_held) {
        Some(held) if held < last => held + 1,
        Some(_) => (1..=last).min_by(|&a, &b| quality(a).total_cmp(&quality(b))).unwrap_or(last),
        None => 1,
    };
    let deviation = |pair| (pair_distance(&bodies[step], pair) - FORMATION_SIDE).abs();
    let by_deviation = |a: &SatellitePair, b: &SatellitePair| deviation(*a).total_cmp(&deviation(*b));
    let pair = PAIRS.into_iter().max_by(by_deviation).unwrap_or(PAIRS[0]);
    let (distance, distance_at_end) =
        (pair_distance(&bodies[step], pair), pair_distance(&bodies[last], pair));
    let SatellitePair { first, second } = pair;
    Failure {
        mode: KesslerFailureMode::BreakUp.name(),
        agent: first as u32,
        step: step as u32,
        encounter: None,
        orbit_angle_deg: None,
        measures: vec![
            Measure::new("other", second as f64, ""),
            Measure::new("distance", distance, "LU"),
            Measure::new("distance_at_end", distance_at_end, "LU"),
            Measure::new("goal", goal, ""),
        ],
        explanation: format!(
            "The formation was lost at step {step}: satellites {first} and {second} were {distance:.1} LU apart, \
             {distance_at_end:.1} at the end, not {FORMATION_SIDE:.0}; mean formation quality {goal:.2} over the last steps."
        ),
    }
}

fn pair_distance(bodies: &Bodies, pair: SatellitePair) -> f64 {
    let (a, b) = (&bodies[pair.first], &bodies[pair.second]);
    distance_squared(a.x, a.y, b.x, b.y).sqrt()
}
