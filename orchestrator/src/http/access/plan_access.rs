//! Decides who may read the planner's plan of a scenario. Critiques follow the same rule, because they name avoiding actions.
//!
//! A client that knows the plan of a scenario can report it as the actions of its own episodes: a replay confirms the score.

use axum::http::StatusCode;
use env_core::{Scenario, SeedSpace};
use sqlx::SqliteConnection;
use store::role::Role;
use store::scenario_use::{self, ScenarioKeys, ScenarioUse};
use store::{StoreError, to_i64};

use super::super::problem::Problem;
use super::Caller;

/// Reason why a client may not read the planner's plan of a scenario.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(in crate::http) enum PlanDenial {
    /// The scenario has an evaluation seed.
    #[error("The server discloses no plan and no avoiding action of an evaluation scenario.")]
    EvaluationScenario,
    /// The client's token has the role trainer.
    #[error(
        "A token with the role trainer may read no plan and no avoiding action; use a token with the role viewer or admin."
    )]
    TrainerToken,
    /// A run may still roll the scenario out.
    #[error("{}", describe_use(.0))]
    ScenarioInUse(ScenarioUse),
}

impl From<PlanDenial> for Problem {
    fn from(denial: PlanDenial) -> Self {
        let (status, code) = match denial {
            PlanDenial::EvaluationScenario => (StatusCode::FORBIDDEN, "evaluation_scenario"),
            PlanDenial::TrainerToken => (StatusCode::FORBIDDEN, "forbidden"),
            PlanDenial::ScenarioInUse(_) => (StatusCode::CONFLICT, "scenario_in_use"),
        };
        Self::new(status, code, denial.to_string())
    }
}

/// Returns the reason why a client may not read the planner's plan of a scenario; `None` if it may.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub(in crate::http) async fn plan_denial(
    conn: &mut SqliteConnection,
    caller: &Caller,
    scenario: &Scenario,
) -> Result<Option<PlanDenial>, StoreError> {
    if scenario.seed().space() == SeedSpace::Evaluation {
        return Ok(Some(PlanDenial::EvaluationScenario));
    }
    if caller.role == Some(Role::Trainer) {
        return Ok(Some(PlanDenial::TrainerToken));
    }
    let keys = ScenarioKeys {
        id: &scenario.id().0,
        recipe: &scenario.recipe().id().0,
        seed: to_i64(scenario.seed().get()),
    };
    Ok(scenario_use::find(conn, keys).await?.map(PlanDenial::ScenarioInUse))
}

/// Returns a sentence that says which run uses the scenario, and when its plan is disclosed.
fn describe_use(scenario_use: &ScenarioUse) -> String {
    match scenario_use {
        ScenarioUse::Leased(run) => format!(
            "Run {run} has an open group of this scenario; the plan and avoiding actions are disclosed when the group is closed."
        ),
        ScenarioUse::Queued(run) => format!(
            "Run {run} has this scenario in its queue; the plan and avoiding actions are disclosed when no run queues or leases it."
        ),
    }
}
