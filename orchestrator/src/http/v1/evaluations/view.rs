//! An evaluation as it is told.

use serde::Serialize;
use utoipa::ToSchema;

use crate::clock::rfc3339;
use crate::ids::EvaluationId;
use crate::store::evaluations::EvaluationRow;

/// An evaluation without its numbers.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Evaluation {
    /// Its id.
    id: String,
    /// Its name for people.
    name: String,
    /// The suite.
    suite: String,
    /// Its hash: evaluations of the same compare.
    suite_hash: String,
    /// The tasks of it that are flown; none: all.
    tasks: Option<Vec<String>>,
    /// The policy.
    policy: String,
    /// The run whose trainer flies it; none: the server does.
    run: Option<String>,
    /// The version of the run's policy.
    version: Option<i64>,
    /// What trainings of one kind are called together.
    training: Option<String>,
    /// By what this one differs from them.
    training_seed: Option<i64>,
    /// Episodes of each scenario.
    rollouts: i64,
    /// Whether these differ by chance.
    chance: bool,
    /// `open` (its trainer leases scenarios), `flying` (the server does), `complete` or `failed`.
    state: String,
    /// Why it failed.
    trouble: Option<String>,
    /// Scenarios that are to be flown.
    scenarios: i64,
    /// Of these, flown.
    flown: i64,
    /// How often scenarios were offered again because a group that flew them lost episodes or its lease ended first. What such groups
    /// did is in no number here: where there are many of them, see that it is not the bad ones that get lost.
    reflown: i64,
    /// When it was begun, RFC 3339.
    created_at: String,
    /// When the last scenario was flown, RFC 3339.
    completed_at: Option<String>,
}

impl From<EvaluationRow> for Evaluation {
    fn from(row: EvaluationRow) -> Self {
        Self {
            id: EvaluationId(row.id).to_string(),
            name: row.name,
            suite: row.suite,
            suite_hash: row.suite_hash,
            tasks: row.tasks.and_then(|tasks| serde_json::from_str(&tasks).ok()),
            policy: row.policy,
            run: row.run,
            version: row.version,
            training: row.training,
            training_seed: row.training_seed,
            rollouts: row.rollouts,
            chance: row.chance,
            state: row.state.to_string(),
            trouble: row.trouble,
            scenarios: row.scenarios,
            flown: row.flown,
            reflown: row.reflown,
            created_at: rfc3339(row.created_at),
            completed_at: row.completed_at.map(rfc3339),
        }
    }
}
