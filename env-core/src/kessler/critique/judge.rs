//! The deterministic judge, from −1 to 1: the scale on which LLM judges of such episodes speak.

use super::Case;
use super::loss::Loss;
use crate::bracket::Flown;
use crate::critique::{Judged, Verdict};
use crate::kessler::constants::{EPSILON, GOAL, SATELLITES};

/// Better than hold by so much: the burns served the task.
const SERVED: f64 = 0.01;

/// The judge's word; `starved` are the satellites whose fuel was short for what would have helped.
pub(super) fn judge(case: &Case<'_>, losses: &[Loss], starved: &[u32]) -> Judged {
    let flown = case.flown();
    let hold = case.plans.hold().flown;
    let hold_does = hold.lost == 0 && hold.goal.is_none_or(|goal| goal >= GOAL);
    let serves = flown.goal.is_some() && flown.score - hold.score >= SERVED;
    let judged = if hold_does && flown.fuel_used <= 0.0 {
        quiet(flown)
    } else if flown.lost > 0 {
        lost(case, losses, starved, &hold)
    } else if hold_does && !serves {
        unnecessary(case)
    } else {
        match flown.goal {
            None => avoided(case, &hold),
            Some(goal) if goal >= GOAL => reached(case, goal),
            Some(goal) => missed(goal),
        }
    };
    Judged { value: judged.value.clamp(-1.0, 1.0), ..judged }
}

/// 0 to 1 by the share of all reward there is.
fn quiet(flown: &Flown) -> Judged {
    Judged {
        value: (flown.total / (1.0 - 2.0 * EPSILON)).clamp(0.0, 1.0),
        case: "no_action_needed",
        words: "Nothing had to be done, and nothing was.".to_owned(),
    }
}

/// −0.5 to −1 by the share of all fuel that was spent.
fn unnecessary(case: &Case<'_>) -> Judged {
    let flown = case.flown();
    let share = (flown.fuel_used / (SATELLITES as f64 * case.setup.fuel)).min(1.0);
    Judged {
        value: -0.5 - 0.5 * share,
        case: "unnecessary_burn",
        words: format!("Holding would have done; {:.2} fuel was spent.", flown.fuel_used),
    }
}

/// −1 where somebody could have known better or did the harm, 0 where no burn that was tried would have helped.
fn lost(case: &Case<'_>, losses: &[Loss], starved: &[u32], hold: &Flown) -> Judged {
    if hold.lost == 0 && case.flown().goal.is_none() {
        return Judged {
            value: -1.0,
            case: "harmful_burn",
            words: format!(
                "{} lost after burning, where holding would have lost nobody.",
                satellites(losses)
            ),
        };
    }
    let missed: Vec<&Loss> = losses.iter().filter(|loss| loss.avoidable == Some(true)).collect();
    if missed.is_empty() && case.verdicts.iter().any(|v| v.verdict == Verdict::Harmful) {
        return Judged {
            value: -1.0,
            case: "harmful_burn",
            words: format!(
                "{} lost, and without some burn it would have gone better: fewer lost, the goal met, or longer lives.",
                satellites(losses)
            ),
        };
    }
    let squandered: Vec<&Loss> = losses
        .iter()
        .filter(|loss| starved.contains(&(loss.satellite as u32)))
        .filter(|loss| case.spent(|v| v.agent as usize == loss.satellite).0 > 0.0)
        .collect();
    if missed.is_empty() && !squandered.is_empty() {
        return Judged {
            value: -1.0,
            case: "fuel_squandered",
            words: format!("{} lost for want of fuel that had been spent before.", satellites(squandered)),
        };
    }
    if missed.is_empty() {
        return Judged {
            value: 0.0,
            case: "unavoidable",
            words: format!(
                "{} lost to what no single burn that was tried would have avoided, knowing what was visible.",
                satellites(losses)
            ),
        };
    }
    Judged {
        value: -1.0,
        case: "threat_missed",
        words: format!("{} lost to what was visible and could have been avoided.", satellites(missed)),
    }
}

fn satellites<'a>(losses: impl IntoIterator<Item = &'a Loss>) -> String {
    let names: Vec<String> = losses.into_iter().map(|loss| loss.satellite.to_string()).collect();
    let (noun, verb) = if names.len() == 1 { ("Satellite", "was") } else { ("Satellites", "were") };
    format!("{noun} {} {verb}", names.join(" and "))
}

/// 0.8 to 1 by the share of the fuel that went into needed burns.
fn avoided(case: &Case<'_>, hold: &Flown) -> Judged {
    let (needed, _) = case.spent(|v| v.verdict == Verdict::Needed);
    let share = (needed / case.flown().fuel_used).min(1.0);
    Judged {
        value: 0.8 + 0.2 * share,
        case: "threat_avoided",
        words: format!(
            "Holding would have lost {}; nobody was, and {:.0} % of {:.2} fuel was needed for it.",
            hold.lost,
            100.0 * share,
            case.flown().fuel_used
        ),
    }
}

/// 0.8 to 1 by the share of the fuel that was not wasted.
fn reached(case: &Case<'_>, goal: f64) -> Judged {
    let (wasted, _) = case.spent(|v| matches!(v.verdict, Verdict::Wasteful | Verdict::Harmful));
    let used = case.flown().fuel_used;
    let share = if used > 0.0 { (1.0 - wasted / used).max(0.0) } else { 1.0 };
    Judged {
        value: 0.8 + 0.2 * share,
        case: "goal_reached",
        words: format!(
            "The goal was held at {goal:.2} with nobody lost; {:.0} % of {used:.1} fuel was not wasted.",
            100.0 * share
        ),
    }
}

/// −0.5 to 0.5 by how well the goal was held.
fn missed(goal: f64) -> Judged {
    Judged {
        value: goal / GOAL - 0.5,
        case: "goal_missed",
        words: format!("Nobody was lost, and the goal was held at {goal:.2} of the {GOAL} it asks."),
    }
}
