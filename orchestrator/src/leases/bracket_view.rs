//! Conversion of a bracket to the form in which trainers receive it.

use api_types::ScenarioBracket;
use env_core::admission::count_panel_successes;

/// Builds the response form of a scenario's bracket.
#[must_use]
pub fn scenario_bracket(scenario: &env_core::Scenario, bracket: &env_core::Bracket) -> ScenarioBracket {
    ScenarioBracket {
        planner_version: bracket.planner_version,
        floor: bracket.floor,
        hold: bracket.hold_score(),
        reference: bracket.reference.score,
        panel_successes: count_panel_successes(scenario, bracket),
        panel_size: bracket.panel.len(),
    }
}
