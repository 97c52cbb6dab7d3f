//! What a scenario is worth: the blind panel, the floor, the reference, and what follows from them.

use crate::error::ScenarioError;
use crate::log::ActionLog;
use crate::scenario::Scenario;

/// How one plan fared on a scenario.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flown {
    /// The world's score.
    pub score: f64,
    /// The sum of rewards, as the wire shows it.
    pub total: f64,
    /// Steps flown.
    pub steps: u32,
    /// Agents lost.
    pub lost: u32,
    /// How well the task's goal was held towards the end, where it has one (kessler/rendezvous: mean proximity).
    pub goal: Option<f64>,
    /// Fuel spent by all agents, in the world's unit.
    pub fuel_used: f64,
}

/// When an episode counts as a success.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SuccessRule {
    /// The task's own rule, which judges skill against floor and reference.
    Task,
    /// The raw rule: the score reaches a threshold.
    Raw(f64),
}

/// Denominator of skill below which there is none: acting well and acting blindly come to the same.
pub const MIN_GAP: f64 = 0.05;

/// Panel, floor and reference of a scenario.
#[derive(Debug, Clone, PartialEq)]
pub struct Bracket {
    /// Version of the planner that made it.
    pub planner: u32,
    /// How each blind plan fared; hold is the first.
    pub panel: Vec<Flown>,
    /// The score of acting blindly, by the task's rule.
    pub floor: f64,
    /// What the planner earned: a lower bound on the best, with hindsight.
    pub reference: Flown,
    /// The actions that earn it.
    pub witness: ActionLog,
}

impl Bracket {
    /// The hold plan's score.
    #[must_use]
    pub fn hold(&self) -> f64 {
        self.panel.first().map_or(0.0, |flown| flown.score)
    }

    /// Blind plans that may succeed on a contested scenario: half of them.
    #[must_use]
    pub const fn most_blind_successes(&self) -> usize {
        self.panel.len() / 2
    }

    /// (score − floor)/(reference − floor) within [−1, 1]; none where the denominator is below 0.05.
    #[must_use]
    pub fn skill(&self, score: f64) -> Option<f64> {
        let gap = self.reference.score - self.floor;
        (gap >= MIN_GAP).then(|| ((score - self.floor) / gap).clamp(-1.0, 1.0))
    }
}

/// What the gate of the worlds says of a scenario. `fair` is always answered; the rest rests on the bracket.
#[derive(Debug, Clone, PartialEq)]
pub struct Admission {
    /// Nothing is lost before anybody could act.
    pub fair: Result<(), ScenarioError>,
    /// The bracket, where the scenario is fair.
    pub bracket: Option<Bracket>,
    /// The reference succeeds.
    pub solvable: bool,
    /// The reference succeeds and acting blindly mostly does not: acting well matters here.
    pub contested: bool,
}

/// Answers fair, solvable, contested, with the bracket. The one question that the curriculum, layout edits and the
/// designer's gate all ask.
#[must_use]
pub fn admit(scenario: &Scenario) -> Admission {
    admission(scenario, scenario.task().bracket(scenario))
}

/// The same for as long as it is `wanted`; `None` where it was given up.
#[must_use]
pub fn admit_while(scenario: &Scenario, wanted: &dyn Fn() -> bool) -> Option<Admission> {
    match scenario.task().bracket_while(scenario, wanted) {
        Ok(None) => None,
        Ok(Some(bracket)) => Some(admission(scenario, Ok(bracket))),
        Err(error) => Some(admission(scenario, Err(error))),
    }
}

fn admission(scenario: &Scenario, bracket: Result<Bracket, ScenarioError>) -> Admission {
    match bracket {
        Err(error) => Admission { fair: Err(error), bracket: None, solvable: false, contested: false },
        Ok(bracket) => Admission {
            fair: Ok(()),
            solvable: solvable(scenario, &bracket),
            contested: contested(scenario, &bracket),
            bracket: Some(bracket),
        },
    }
}

/// Whether an episode with this outcome is a success, judged by this bracket.
#[must_use]
pub fn success(scenario: &Scenario, rule: SuccessRule, bracket: &Bracket, flown: &Flown) -> bool {
    match rule {
        SuccessRule::Task => scenario.task().success(flown, bracket.skill(flown.score)),
        SuccessRule::Raw(threshold) => flown.score >= threshold,
    }
}

/// Whether the reference succeeds.
#[must_use]
pub fn solvable(scenario: &Scenario, bracket: &Bracket) -> bool {
    success(scenario, SuccessRule::Task, bracket, &bracket.reference)
}

/// How many blind plans succeed.
#[must_use]
pub fn panel_success(scenario: &Scenario, bracket: &Bracket) -> usize {
    bracket.panel.iter().filter(|flown| success(scenario, SuccessRule::Task, bracket, flown)).count()
}

/// The share of blind plans that succeed.
#[must_use]
pub fn panel_share(scenario: &Scenario, bracket: &Bracket) -> f64 {
    panel_success(scenario, bracket) as f64 / bracket.panel.len().max(1) as f64
}

/// Whether acting well matters on this scenario: by the task's own rule, whatever rule a run judges its episodes by.
#[must_use]
pub fn contested(scenario: &Scenario, bracket: &Bracket) -> bool {
    if !solvable(scenario, bracket) {
        return false;
    }
    !scenario.task().blind_can_succeed()
        || (bracket.reference.score - bracket.floor >= MIN_GAP
            && panel_success(scenario, bracket) <= bracket.most_blind_successes())
}
