//! What a design claims, and whether its layout keeps it.

use env_core::bracket::{Bracket, SuccessRule, success};
use env_core::critique::Verdict;
use env_core::kessler::constants::FAIR_STEPS;
use env_core::log::Precision;
use env_core::rollout::fly;
use env_core::{ActionLog, Scenario, ScenarioError, Stopped};

use super::agents::{Weakness, agent};
use super::language::{Design, Encounter, Kind};
use super::place::{Placed, difference};
use crate::Fault;

/// Failure modes that a layout can aim at, and what it takes: which kinds of encounter, of which a rogue or not.
pub const AIMS: [(&str, Kind, Option<bool>, &str); 4] = [
    ("collision", Kind::Threat, Some(false), "a threat that is there from the start"),
    ("rogue", Kind::Threat, Some(true), "a threat that is a rogue"),
    ("fuel_starvation", Kind::Threat, None, "two threats of one satellite"),
    ("wasted_fuel", Kind::Decoy, None, "a decoy, and no threat"),
];

/// How far from the aimed bearing an encounter that keeps the aim may be, degrees: half a sector of the profile.
pub const AIM_WIDTH: f64 = 15.0;
/// Fuel that a nervous agent must spend on a decoy's satellite for the decoy to tempt anybody.
pub const TEMPTED: f64 = 1.0;

/// A claim that is not kept.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Broken {
    /// No layout can aim at this.
    #[error(
        "aim.mode: nothing can be laid out for {mode:?}; choose one of collision, rogue, fuel_starvation, wasted_fuel"
    )]
    Mode {
        /// The mode.
        mode: String,
    },
    /// The encounters do not do what the aim needs.
    #[error("aim: {mode} takes {needs}, and the encounters have none")]
    Needs {
        /// The mode.
        mode: String,
        /// What it takes.
        needs: &'static str,
    },
    /// No encounter comes from where the aim says.
    #[error(
        "aim.bearing_deg: it is {aimed}, and the nearest encounter that counts comes from {nearest:.0}: within {AIM_WIDTH} degrees is wanted"
    )]
    Bearing {
        /// Where the aim is.
        aimed: u32,
        /// Where the nearest is.
        nearest: f64,
    },
    /// A decoy layout in which holding loses.
    #[error("encounters: holding loses {lost} of the satellites, so that burning is no waste")]
    Hits {
        /// Satellites lost.
        lost: u32,
    },
    /// A decoy layout that tempts nobody.
    #[error(
        "encounters: even a nervous agent spends only {spent:.1} fuel for nothing: bring the decoys nearer, {TEMPTED} is wanted"
    )]
    Dull {
        /// What it spends in vain.
        spent: f64,
    },
}

impl From<Broken> for Fault {
    fn from(broken: Broken) -> Self {
        let words = broken.to_string();
        let (field, words) = words.split_once(": ").unwrap_or(("design", &words));
        Self::new(field, words)
    }
}

/// Whether the layout is one of threats: some encounter is to hit.
#[must_use]
pub fn threatens(design: &Design) -> bool {
    design.encounters.iter().any(|e| e.kind == Kind::Threat)
}

/// Whether the encounters are what the aim says.
///
/// # Errors
/// What is missing.
pub fn aim(design: &Design, placed: &[Placed]) -> Result<(), Broken> {
    let mode = &design.aim.mode;
    let Some((_, kind, rogue, needs)) = AIMS.iter().find(|row| row.0 == mode) else {
        return Err(Broken::Mode { mode: mode.clone() });
    };
    let counts = |e: &Encounter| e.kind == *kind && rogue.is_none_or(|rogue| e.rogue == rogue);
    let counting: Vec<(&Encounter, &Placed)> =
        design.encounters.iter().zip(placed).filter(|(e, _)| counts(e)).collect();
    let enough = match mode.as_str() {
        "fuel_starvation" => counting
            .iter()
            .any(|(e, _)| counting.iter().filter(|(other, _)| other.satellite == e.satellite).count() > 1),
        "wasted_fuel" => !counting.is_empty() && !threatens(design),
        _ => !counting.is_empty(),
    };
    if !enough {
        return Err(Broken::Needs { mode: mode.clone(), needs });
    }
    let Some(aimed) = design.aim.bearing_deg else { return Ok(()) };
    let off = |bearing: f64| difference(f64::from(aimed), bearing).abs();
    let nearest = counting.iter().map(|(_, p)| p.bearing_deg).min_by(|a, b| off(*a).total_cmp(&off(*b)));
    match nearest {
        Some(nearest) if off(nearest) > AIM_WIDTH => Err(Broken::Bearing { aimed, nearest }),
        _ => Ok(()),
    }
}

/// That what hits who holds hits nobody before step 3, and is seen while there is still a burn that dodges it. Fragments
/// are what an earlier loss left.
pub fn seen(scenario: &Scenario) -> Result<(), Fault> {
    let mut hold = ActionLog::new(scenario.task().action_space().columns.len(), Precision::F64);
    hold.stopped = Some(Stopped::TooLate);
    // A start that is not fair is refused in its own words by who brackets it.
    let Ok(critique) = scenario.task().critique(scenario, &hold) else { return Ok(()) };
    let hits = critique.failures.iter().filter(|failure| matches!(failure.mode, "collision" | "rogue"));
    for failure in hits {
        let Some(met) = &failure.encounter else { continue };
        let (who, step) = (failure.agent, failure.step);
        let words = match (met.first_visible_step, met.avoidable) {
            _ if step <= FAIR_STEPS => {
                format!("satellite {who} is hit at step {step}, before anybody could act")
            }
            (None, _) => format!(
                "satellite {who} is hit at step {step} by what no radar shows before: a slower pass is wanted, or a rogue \
                 that is seen coming"
            ),
            (Some(first), Some(false)) => format!(
                "satellite {who} is hit at step {step} by what the radar shows from step {first} on, when no burn dodges it \
                 any more: a slower pass is wanted"
            ),
            _ => continue,
        };
        return Err(Fault::new("encounters", words));
    }
    Ok(())
}

/// Whether a layout of decoys is honest: who holds loses nobody and succeeds, and who burns for what comes near wastes.
///
/// # Errors
/// What is not so, or a scenario that cannot be flown.
pub fn decoy(scenario: &Scenario, bracket: &Bracket) -> Result<Result<(), Broken>, ScenarioError> {
    let hold = &bracket.panel[0];
    if hold.lost > 0 || !success(scenario, SuccessRule::Task, bracket, hold) {
        return Ok(Err(Broken::Hits { lost: hold.lost }));
    }
    let spent = tempted(scenario)?;
    Ok(if spent < TEMPTED { Err(Broken::Dull { spent }) } else { Ok(()) })
}

/// Fuel that a nervous agent spends on burns that were needed for nothing.
fn tempted(scenario: &Scenario) -> Result<f64, ScenarioError> {
    let refused = |error: String| ScenarioError::Layout { field: "layout".to_owned(), reason: error };
    let mut nervous = agent(Weakness::Nervous, scenario).map_err(|e| refused(e.to_string()))?;
    let (_, log) = fly(scenario, &mut *nervous).map_err(|e| refused(e.to_string()))?;
    let critique = scenario.task().critique(scenario, &log).map_err(|e| refused(e.to_string()))?;
    let vain = critique.actions.iter().filter(|action| action.verdict != Verdict::Needed);
    // The sum of nothing is −0.
    Ok(vain.map(|action| action.cost).sum::<f64>() + 0.0)
}
