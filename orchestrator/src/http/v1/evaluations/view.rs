//! Conversion of stored evaluations to responses.

use api_types::EvaluationSummary;

use crate::clock::rfc3339;
use crate::ids::EvaluationId;
use crate::store::evaluations::EvaluationRow;

/// Converts the row of an evaluation.
pub(super) fn evaluation_summary(row: EvaluationRow) -> EvaluationSummary {
    EvaluationSummary {
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
