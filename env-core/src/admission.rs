//! Judgements of scenarios and episodes by a bracket: fair, solvable, contested, success.

use crate::bracket::{Bracket, EpisodeOutcome, MIN_GAP};
use crate::error::ScenarioError;
use crate::task::Scenario;

/// Rule by which an episode counts as a success.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SuccessRule {
    /// The task's own rule, which judges skill between floor and reference.
    Task,
    /// The score reaches this threshold.
    Raw(f64),
}

/// Judgement of a scenario.
#[derive(Debug, Clone, PartialEq)]
pub struct Admission {
    /// `Ok` if no agent is lost before it could act.
    pub fair: Result<(), ScenarioError>,
    /// The bracket, if the scenario is fair.
    pub bracket: Option<Bracket>,
    /// True if the reference succeeds.
    pub solvable: bool,
    /// True if the reference succeeds and acting blindly mostly does not, so that acting well matters.
    pub contested: bool,
}

/// Judges a scenario. The curriculum, layout edits and the designer's gate all use this function.
#[must_use]
pub fn admit(scenario: &Scenario) -> Admission {
    judge_bracket(scenario, scenario.task().bracket(scenario))
}

/// Judges a scenario, or returns `None` once `wanted` returns false (see
/// [`TaskSpec::bracket_while`](crate::TaskSpec::bracket_while)).
#[must_use]
pub fn admit_while(scenario: &Scenario, wanted: &dyn Fn() -> bool) -> Option<Admission> {
    match scenario.task().bracket_while(scenario, wanted) {
        Ok(None) => None,
        Ok(Some(bracket)) => Some(judge_bracket(scenario, Ok(bracket))),
        Err(error) => Some(judge_bracket(scenario, Err(error))),
    }
}

/// True if an episode with this outcome is a success.
#[must_use]
pub fn is_success(
    scenario: &Scenario,
    rule: SuccessRule,
    bracket: &Bracket,
    outcome: &EpisodeOutcome,
) -> bool {
    match rule {
        SuccessRule::Task => scenario.task().is_success(outcome, bracket.skill(outcome.score)),
        SuccessRule::Raw(threshold) => outcome.score >= threshold,
    }
}

/// True if the reference succeeds.
#[must_use]
pub fn is_solvable(scenario: &Scenario, bracket: &Bracket) -> bool {
    is_success(scenario, SuccessRule::Task, bracket, &bracket.reference)
}

/// True if acting well matters on this scenario. This is judged by the task's own rule, whichever rule a run judges its
/// episodes by.
#[must_use]
pub fn is_contested(scenario: &Scenario, bracket: &Bracket) -> bool {
    if !is_solvable(scenario, bracket) {
        return false;
    }
    !scenario.task().blind_can_succeed()
        || (bracket.reference.score - bracket.floor >= MIN_GAP
            && count_panel_successes(scenario, bracket) <= bracket.max_blind_successes())
}

/// Number of blind plans that succeed.
#[must_use]
pub fn count_panel_successes(scenario: &Scenario, bracket: &Bracket) -> usize {
    bracket.panel.iter().filter(|outcome| is_success(scenario, SuccessRule::Task, bracket, outcome)).count()
}

/// Share of blind plans that succeed, from 0 to 1.
#[must_use]
pub fn panel_success_rate(scenario: &Scenario, bracket: &Bracket) -> f64 {
    count_panel_successes(scenario, bracket) as f64 / bracket.panel.len().max(1) as f64
}

fn judge_bracket(scenario: &Scenario, bracket: Result<Bracket, ScenarioError>) -> Admission {
    match bracket {
        Err(error) => Admission { fair: Err(error), bracket: None, solvable: false, contested: false },
        Ok(bracket) => Admission {
            fair: Ok(()),
            solvable: is_solvable(scenario, &bracket),
            contested: is_contested(scenario, &bracket),
            bracket: Some(bracket),
        },
    }
}
