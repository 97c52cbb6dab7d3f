//! Outcomes of episodes, and the bracket that scores are measured in: blind panel, floor and reference.

use crate::log::ActionLog;

/// Outcome of an episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpisodeOutcome {
    /// Score by the world's rule.
    pub score: f64,
    /// Sum of rewards, as telemetry shows it.
    pub total_reward: f64,
    /// Number of steps taken.
    pub steps: u32,
    /// Number of agents lost.
    pub lost: u32,
    /// How well the task's goal was held towards the end, if it has one (kessler/rendezvous: mean proximity).
    pub goal: Option<f64>,
    /// Fuel spent by all agents, in the world's unit.
    pub fuel_used: f64,
    /// Duration of the episode, s; `None` in a world that counts steps.
    pub time_s: Option<f64>,
}

/// Smallest difference of reference and floor for which skill is defined. Below it, acting well and acting blindly score
/// about the same.
pub const MIN_GAP: f64 = 0.05;

/// Blind panel, floor and reference of a scenario.
#[derive(Debug, Clone, PartialEq)]
pub struct Bracket {
    /// Version of the planner that computed it.
    pub planner_version: u32,
    /// Outcome of each blind plan; the first plan is hold.
    pub panel: Vec<EpisodeOutcome>,
    /// Score of acting blindly, by the task's rule.
    pub floor: f64,
    /// Outcome of the planner, which has hindsight: a lower bound on the best.
    pub reference: EpisodeOutcome,
    /// The planner's actions, which reach `reference`.
    pub reference_plan: ActionLog,
}

impl Bracket {
    /// Score of the hold plan.
    #[must_use]
    pub fn hold_score(&self) -> f64 {
        self.panel.first().map_or(0.0, |outcome| outcome.score)
    }

    /// Largest number of blind plans that may succeed on a contested scenario: half of them.
    #[must_use]
    pub const fn max_blind_successes(&self) -> usize {
        self.panel.len() / 2
    }

    /// Skill of a score: (score − floor)/(reference − floor), clamped to [−1, 1]. `None` if the denominator is below
    /// [`MIN_GAP`].
    #[must_use]
    pub fn skill(&self, score: f64) -> Option<f64> {
        let gap = self.reference.score - self.floor;
        (gap >= MIN_GAP).then(|| ((score - self.floor) / gap).clamp(-1.0, 1.0))
    }
}
