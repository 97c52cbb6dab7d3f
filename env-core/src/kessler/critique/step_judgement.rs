//! Deterministic judgement of one step: the last of an episode so far, as if no satellite burnt after it.

use super::analysis::EpisodeAnalysis;
use super::losses::SatelliteLoss;
use crate::critique::{Judgement, Verdict};
use crate::kessler::constants::{GOAL_THRESHOLD, SATELLITES};

/// Largest time to a hit for which inaction is penalised, steps.
const PENDING_STEPS: u32 = 3;

/// Judges step `now`, counted from 1.
pub(super) fn judge(analysis: &EpisodeAnalysis<'_>, losses: &[SatelliteLoss], now: u32) -> Judgement {
    let mut burns = analysis.verdicts.iter().filter(|verdict| verdict.step == now);
    if let Some(burn) = burns.find(|burn| burn.verdict == Verdict::Harmful) {
        let explanation =
            format!("The outcome would be better without the burn of satellite {}.", burn.agent);
        return Judgement { value: -1.0, case: "harmful_burn", explanation };
    }
    if let Some(judgement) = lost_now(losses, now) {
        return judgement;
    }
    let needed = analysis.total_burns(|v| v.step == now && v.verdict == Verdict::Needed).cost;
    let spent = analysis.total_burns(|v| v.step == now).cost;
    if needed > 0.0 {
        let share = needed / spent;
        let explanation = format!("{:.0} % of the {spent:.2} fuel spent was needed.", 100.0 * share);
        return Judgement { value: 0.8 + 0.2 * share, case: "needed_burn", explanation };
    }
    if spent > 0.0 {
        let share = (spent / (SATELLITES as f64 * analysis.setup.fuel)).min(1.0);
        let explanation = format!("Holding would be as good; {spent:.2} fuel was spent.");
        return Judgement { value: -0.5 - 0.5 * share, case: "unnecessary_burn", explanation };
    }
    pending_threat(losses, now).unwrap_or_else(|| no_action_needed(analysis, losses, now))
}

/// Judgement if a satellite was lost in this step.
fn lost_now(losses: &[SatelliteLoss], now: u32) -> Option<Judgement> {
    let lost = || losses.iter().filter(|loss| loss.event.step == now);
    lost().next()?;
    let avoidable = lost().find(|loss| loss.avoidable == Some(true));
    Some(match avoidable {
        Some(loss) => {
            let explanation = format!(
                "Satellite {} was lost although the threat was visible and avoidable.",
                loss.satellite
            );
            Judgement { value: -1.0, case: "threat_missed", explanation }
        }
        None => Judgement {
            value: 0.0,
            case: "unavoidable",
            explanation: "No single burn that was tried would have avoided the loss.".to_owned(),
        },
    })
}

/// Judgement of inaction while debris that is already visible will hit within a few steps: the sooner, the
/// worse.
fn pending_threat(losses: &[SatelliteLoss], now: u32) -> Option<Judgement> {
    let is_known = |loss: &&SatelliteLoss| {
        let encounter = loss.failure.encounter.as_ref();
        let visible = encounter.and_then(|encounter| encounter.first_visible_step);
        visible.is_some_and(|step| step < now) && loss.avoidable == Some(true)
    };
    let pending = losses.iter().filter(|loss| (now + 1..=now + PENDING_STEPS).contains(&loss.event.step));
    let first = pending.filter(is_known).min_by_key(|loss| loss.event.step)?;
    let left = first.event.step - now;
    let steps = if left == 1 { "step" } else { "steps" };
    Some(Judgement {
        value: -f64::from(PENDING_STEPS + 1 - left) / f64::from(PENDING_STEPS + 1),
        case: "threat_waits",
        explanation: format!(
            "The debris that hits satellite {} in {left} {steps} was visible, and no action was taken.",
            first.satellite
        ),
    })
}

/// Judgement of inaction without a pending threat: the share of active satellites, or the value of the goal
/// if no action follows.
fn no_action_needed(analysis: &EpisodeAnalysis<'_>, losses: &[SatelliteLoss], now: u32) -> Judgement {
    if let Some(goal) = analysis.outcome().goal.filter(|goal| *goal < GOAL_THRESHOLD) {
        return Judgement {
            value: (goal / GOAL_THRESHOLD - 0.5).clamp(-0.5, 0.5),
            case: "goal_waits",
            explanation: format!(
                "Without further action the goal is held at {goal:.2} of the required {GOAL_THRESHOLD}."
            ),
        };
    }
    let lost = losses.iter().filter(|loss| loss.event.step <= now).count();
    Judgement {
        value: (SATELLITES - lost.min(SATELLITES)) as f64 / SATELLITES as f64,
        case: "no_action_needed",
        explanation: "No action was needed, and none was taken.".to_owned(),
    }
}
