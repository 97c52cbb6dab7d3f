//! Deterministic judgement of an episode, from −1 to 1: the scale of the language-model judges.

use super::analysis::EpisodeAnalysis;
use super::losses::SatelliteLoss;
use crate::bracket::EpisodeOutcome;
use crate::critique::{Judgement, Verdict};
use crate::kessler::constants::{EPSILON, GOAL_THRESHOLD, SATELLITES};

/// Smallest gain of score over hold for which the burns served the goal.
const MIN_SERVING_GAIN: f64 = 0.01;

/// Judges an episode. `starved` are the satellites that lacked fuel for a burn that would have helped.
pub(super) fn judge(analysis: &EpisodeAnalysis<'_>, losses: &[SatelliteLoss], starved: &[u32]) -> Judgement {
    let outcome = analysis.outcome();
    let hold = analysis.counterfactuals.hold_outcome().outcome;
    let hold_suffices = hold.lost == 0 && hold.goal.is_none_or(|goal| goal >= GOAL_THRESHOLD);
    let burns_serve_goal = outcome.goal.is_some() && outcome.score - hold.score >= MIN_SERVING_GAIN;
    let judgement = if hold_suffices && outcome.fuel_used <= 0.0 {
        no_action_needed(outcome)
    } else if outcome.lost > 0 {
        satellites_lost(analysis, losses, starved, &hold)
    } else if hold_suffices && !burns_serve_goal {
        unnecessary_burn(analysis)
    } else {
        match outcome.goal {
            None => threat_avoided(analysis, &hold),
            Some(goal) if goal >= GOAL_THRESHOLD => goal_reached(analysis, goal),
            Some(goal) => goal_missed(goal),
        }
    };
    Judgement { value: judgement.value.clamp(-1.0, 1.0), ..judgement }
}

/// 0 to 1: the share of the maximum reward.
fn no_action_needed(outcome: &EpisodeOutcome) -> Judgement {
    Judgement {
        value: (outcome.total_reward / (1.0 - 2.0 * EPSILON)).clamp(0.0, 1.0),
        case: "no_action_needed",
        explanation: "No action was needed, and none was taken.".to_owned(),
    }
}

/// −0.5 to −1: the more of all fuel was spent, the worse.
fn unnecessary_burn(analysis: &EpisodeAnalysis<'_>) -> Judgement {
    let outcome = analysis.outcome();
    let share = (outcome.fuel_used / (SATELLITES as f64 * analysis.setup.fuel)).min(1.0);
    Judgement {
        value: -0.5 - 0.5 * share,
        case: "unnecessary_burn",
        explanation: format!("Holding was enough; {:.2} fuel was spent.", outcome.fuel_used),
    }
}

/// −1 if the agent could have avoided the loss or caused it, 0 if no burn that was tried would have helped.
fn satellites_lost(
    analysis: &EpisodeAnalysis<'_>,
    losses: &[SatelliteLoss],
    starved: &[u32],
    hold: &EpisodeOutcome,
) -> Judgement {
    let worst = |case, explanation| Judgement { value: -1.0, case, explanation };
    if hold.lost == 0 && analysis.outcome().goal.is_none() {
        let explanation =
            format!("{} lost after a burn; holding would have lost no satellite.", subject(losses));
        return worst("harmful_burn", explanation);
    }
    let avoidable: Vec<&SatelliteLoss> = losses.iter().filter(|loss| loss.avoidable == Some(true)).collect();
    if !avoidable.is_empty() {
        let explanation =
            format!("{} lost although the threat was visible and avoidable.", subject(avoidable));
        return worst("threat_missed", explanation);
    }
    if analysis.verdicts.iter().any(|v| v.verdict == Verdict::Harmful) {
        let explanation = format!(
            "{} lost, and the episode would have been better without some burn: fewer losses, the goal met, or longer \
             survival.",
            subject(losses)
        );
        return worst("harmful_burn", explanation);
    }
    let has_spent =
        |loss: &&SatelliteLoss| analysis.total_burns(|v| v.agent as usize == loss.satellite).cost > 0.0;
    let squandered: Vec<&SatelliteLoss> =
        losses.iter().filter(|loss| starved.contains(&(loss.satellite as u32))).filter(has_spent).collect();
    if !squandered.is_empty() {
        let explanation =
            format!("{} lost for lack of fuel that had been spent before.", subject(squandered));
        return worst("fuel_squandered", explanation);
    }
    Judgement {
        value: 0.0,
        case: "unavoidable",
        explanation: format!(
            "{} lost, and no single burn that was tried with the visible debris would have avoided it.",
            subject(losses)
        ),
    }
}

/// Subject and verb of a sentence about lost satellites.
fn subject<'a>(losses: impl IntoIterator<Item = &'a SatelliteLoss>) -> String {
    let numbers: Vec<String> = losses.into_iter().map(|loss| loss.satellite.to_string()).collect();
    let (noun, verb) = if numbers.len() == 1 { ("Satellite", "was") } else { ("Satellites", "were") };
    format!("{noun} {} {verb}", numbers.join(" and "))
}

/// 0.8 to 1: the share of the fuel that went into needed burns.
fn threat_avoided(analysis: &EpisodeAnalysis<'_>, hold: &EpisodeOutcome) -> Judgement {
    let needed = analysis.total_burns(|v| v.verdict == Verdict::Needed).cost;
    let share = (needed / analysis.outcome().fuel_used).min(1.0);
    Judgement {
        value: 0.8 + 0.2 * share,
        case: "threat_avoided",
        explanation: format!(
            "No satellite was lost; holding would have lost {}. {:.0} % of the {:.2} fuel spent was needed.",
            hold.lost,
            100.0 * share,
            analysis.outcome().fuel_used
        ),
    }
}

/// 0.8 to 1: the share of the fuel that was not wasted.
fn goal_reached(analysis: &EpisodeAnalysis<'_>, goal: f64) -> Judgement {
    let is_wasted = |verdict| matches!(verdict, Verdict::Wasteful | Verdict::Harmful);
    let wasted = analysis.total_burns(|v| is_wasted(v.verdict)).cost;
    let used = analysis.outcome().fuel_used;
    let share = if used > 0.0 { (1.0 - wasted / used).max(0.0) } else { 1.0 };
    Judgement {
        value: 0.8 + 0.2 * share,
        case: "goal_reached",
        explanation: format!(
            "The goal was held at {goal:.2} without a loss; {:.0} % of the {used:.1} fuel spent was not wasted.",
            100.0 * share
        ),
    }
}

/// −0.5 to 0.5: the better the goal was held, the higher.
fn goal_missed(goal: f64) -> Judgement {
    Judgement {
        value: goal / GOAL_THRESHOLD - 0.5,
        case: "goal_missed",
        explanation: format!(
            "No satellite was lost, but the goal was held at {goal:.2} of the required {GOAL_THRESHOLD}."
        ),
    }
}
