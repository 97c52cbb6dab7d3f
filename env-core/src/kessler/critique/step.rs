//! The deterministic judge's word on one step: the last of an episode so far, as if nobody burnt after it.

use super::Case;
use super::loss::Loss;
use crate::critique::{ActionVerdict, Judged, Verdict};
use crate::kessler::constants::{GOAL, SATELLITES};

/// A threat that is so many steps away, or fewer, waits for somebody to act.
const WAITS: u32 = 3;

/// The word on step `now`, counted from 1.
pub(super) fn judge(case: &Case<'_>, losses: &[Loss], now: u32) -> Judged {
    let burns: Vec<&ActionVerdict> = case.verdicts.iter().filter(|verdict| verdict.step == now).collect();
    if let Some(burn) = burns.iter().find(|burn| burn.verdict == Verdict::Harmful) {
        let words = format!("Without the burn of satellite {} it would go better.", burn.agent);
        return Judged { value: -1.0, case: "harmful_burn", words };
    }
    if let Some(judged) = lost(losses, now) {
        return judged;
    }
    let (needed, _) = case.spent(|verdict| verdict.step == now && verdict.verdict == Verdict::Needed);
    let (spent, _) = case.spent(|verdict| verdict.step == now);
    if needed > 0.0 {
        let share = needed / spent;
        let words = format!("{:.0} % of {spent:.2} fuel was needed.", 100.0 * share);
        return Judged { value: 0.8 + 0.2 * share, case: "needed_burn", words };
    }
    if spent > 0.0 {
        let share = (spent / (SATELLITES as f64 * case.setup.fuel)).min(1.0);
        let words = format!("Holding would do as well; {spent:.2} fuel was spent.");
        return Judged { value: -0.5 - 0.5 * share, case: "unnecessary_burn", words };
    }
    waits(losses, now).unwrap_or_else(|| quiet(case, losses, now))
}

/// Somebody was lost in this step.
fn lost(losses: &[Loss], now: u32) -> Option<Judged> {
    let gone = || losses.iter().filter(|loss| loss.end.step == now);
    gone().next()?;
    let missed = gone().find(|loss| loss.avoidable == Some(true));
    Some(match missed {
        Some(loss) => {
            let words = format!(
                "Satellite {} was lost to what was visible and could have been avoided.",
                loss.satellite
            );
            Judged { value: -1.0, case: "threat_missed", words }
        }
        None => Judged {
            value: 0.0,
            case: "unavoidable",
            words: "What was lost could not have been saved by any single burn that was tried.".to_owned(),
        },
    })
}

/// Nothing was done, and what was in sight before hits within a few steps if nothing is: the sooner, the worse.
fn waits(losses: &[Loss], now: u32) -> Option<Judged> {
    let seen = |loss: &&Loss| {
        let met = loss.failure.encounter.as_ref();
        let known = met.and_then(|met| met.first_visible_step).is_some_and(|step| step < now);
        known && loss.avoidable == Some(true)
    };
    let soon = losses.iter().filter(|loss| (now + 1..=now + WAITS).contains(&loss.end.step));
    let first = soon.filter(seen).min_by_key(|loss| loss.end.step)?;
    let left = first.end.step - now;
    let steps = if left == 1 { "step" } else { "steps" };
    Some(Judged {
        value: -f64::from(WAITS + 1 - left) / f64::from(WAITS + 1),
        case: "threat_waits",
        words: format!(
            "What hits satellite {} in {left} {steps} was in sight, and nothing was done.",
            first.satellite
        ),
    })
}

/// Nothing was done, and nothing presses: as good as there are satellites left, or as the goal is near without doing more.
fn quiet(case: &Case<'_>, losses: &[Loss], now: u32) -> Judged {
    if let Some(goal) = case.flown().goal.filter(|goal| *goal < GOAL) {
        return Judged {
            value: (goal / GOAL - 0.5).clamp(-0.5, 0.5),
            case: "goal_waits",
            words: format!("If nothing more is done, the goal is held at {goal:.2} of the {GOAL} it asks."),
        };
    }
    let lost = losses.iter().filter(|loss| loss.end.step <= now).count();
    Judged {
        value: (SATELLITES - lost.min(SATELLITES)) as f64 / SATELLITES as f64,
        case: "no_action_needed",
        words: "Nothing had to be done, and nothing was.".to_owned(),
    }
}
