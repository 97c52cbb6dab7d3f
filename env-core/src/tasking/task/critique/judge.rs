//! The deterministic judge: an episode from −1 (all satellites dead) to 1 (as good as the reference).

use crate::bracket::EpisodeOutcome;
use crate::critique::Judgement;

/// Scores that differ by less are equal: sums of rewards in another order.
const TOLERANCE: f64 = 1e-9;

/// Judges an episode of `agents` satellites by its outcome and the score of the reference:
///
/// - all satellites dead: −1
/// - a score of the reference's or more: 1
/// - a score from 0 on: its share of the reference's
/// - a score below 0, which deaths cause: the score
pub(super) fn judge(outcome: &EpisodeOutcome, agents: usize, reference: f64) -> Judgement {
    let score = outcome.score;
    let deaths = match outcome.lost {
        0 => "no satellite died".to_owned(),
        1 => "1 satellite died".to_owned(),
        lost => format!("{lost} satellites died"),
    };
    let scores = format!("The score is {score:.3}, that of the reference is {reference:.3}, and {deaths}.");
    let (value, case) = if outcome.lost as usize >= agents {
        (-1.0, "all_dead")
    } else if score >= reference - TOLERANCE {
        (1.0, "as_reference")
    } else {
        // Below the reference, so that a score from 0 on means a positive reference.
        let value = if score >= 0.0 { score / reference } else { score };
        (value, if outcome.lost > 0 { "satellites_lost" } else { "below_reference" })
    };
    Judgement { value: value.clamp(-1.0, 1.0), case, explanation: scores }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(score: f64, lost: u32, agents: usize, reference: f64) -> (f64, &'static str) {
        let outcome = EpisodeOutcome {
            score,
            total_reward: score,
            steps: 9,
            lost,
            goal: None,
            fuel_used: 0.0,
            time_s: Some(900.0),
        };
        let judged = judge(&outcome, agents, reference);
        (judged.value, judged.case)
    }

    #[test]
    fn values_go_from_the_dead_to_the_reference() {
        assert_eq!(value(-0.7, 1, 1, 0.8), (-1.0, "all_dead"));
        assert_eq!(value(-0.9, 3, 3, -0.95), (-1.0, "all_dead"), "death is never as good as a reference");
        assert_eq!(value(0.8, 0, 1, 0.8), (1.0, "as_reference"));
        assert_eq!(value(0.9, 0, 1, 0.8), (1.0, "as_reference"));
        assert_eq!(value(0.4, 0, 1, 0.8), (0.5, "below_reference"));
        assert_eq!(value(0.0, 0, 1, 0.8), (0.0, "below_reference"));
        assert_eq!(value(-0.2, 1, 3, 0.8), (-0.2, "satellites_lost"));
        assert_eq!(value(0.2, 1, 3, 0.4), (0.5, "satellites_lost"));
        assert_eq!(value(0.0, 0, 1, -0.1), (1.0, "as_reference"), "a reference that lost satellites");
    }
}
