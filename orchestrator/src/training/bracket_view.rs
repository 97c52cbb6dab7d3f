//! What a scenario is worth, as trainers are told.

use env_core::bracket::panel_success;
use serde::Serialize;
use utoipa::ToSchema;

/// What a scenario is worth.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct BracketView {
    /// Version of the planner that made it.
    pub planner: u32,
    /// The score of acting blindly.
    pub floor: f64,
    /// The score of doing nothing.
    pub hold: f64,
    /// What the planner earned, with hindsight.
    pub reference: f64,
    /// How many of the blind plans succeed.
    pub panel_success: usize,
    /// How many blind plans there are.
    pub panel: usize,
}

impl BracketView {
    /// Of a scenario's bracket.
    #[must_use]
    pub fn of(scenario: &env_core::Scenario, bracket: &env_core::Bracket) -> Self {
        Self {
            planner: bracket.planner,
            floor: bracket.floor,
            hold: bracket.hold(),
            reference: bracket.reference.score,
            panel_success: panel_success(scenario, bracket),
            panel: bracket.panel.len(),
        }
    }
}
