//! Bracket of a scenario as trainers receive it.

use env_core::admission::count_panel_successes;
use serde::Serialize;
use utoipa::ToSchema;

/// Scores between which the skill of an episode is measured.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct BracketView {
    /// Version of the reference planner.
    pub planner: u32,
    /// Best score of the blind panel: plans that do not observe the scenario.
    pub floor: f64,
    /// Score of the `hold` policy, which never acts.
    pub hold: f64,
    /// Score of the reference planner, which knows the whole scenario.
    pub reference: f64,
    /// Number of blind plans that succeed.
    pub panel_success: usize,
    /// Number of blind plans.
    pub panel: usize,
}

impl BracketView {
    /// Builds the view of a scenario's bracket.
    #[must_use]
    pub fn of(scenario: &env_core::Scenario, bracket: &env_core::Bracket) -> Self {
        Self {
            planner: bracket.planner_version,
            floor: bracket.floor,
            hold: bracket.hold_score(),
            reference: bracket.reference.score,
            panel_success: count_panel_successes(scenario, bracket),
            panel: bracket.panel.len(),
        }
    }
}
