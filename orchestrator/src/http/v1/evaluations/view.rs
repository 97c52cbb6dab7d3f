//! Conversion of stored evaluations to responses.

use crate::api_enums::ConvertEnum;
use api_types::EvaluationSummary;

use store::evaluations::EvaluationRow;
use store::ids::EvaluationId;
use store::shard::Shard;

use clock::rfc3339;

/// Converts the row of an evaluation of the server of a shard.
pub(super) fn evaluation_summary(row: EvaluationRow, shard: Option<&Shard>) -> EvaluationSummary {
    EvaluationSummary {
        id: EvaluationId { shard: shard.cloned(), number: row.id }.to_string(),
        name: row.name,
        suite: row.suite,
        suite_hash: row.suite_hash,
        tasks: row.tasks.and_then(|tasks| serde_json::from_str(&tasks).ok()),
        policy: row.policy,
        run: row.run,
        policy_version: row.policy_version,
        training: row.training,
        training_seed: row.training_seed,
        rollouts: row.rollouts,
        stochastic: row.is_stochastic,
        state: row.state.convert(),
        error: row.error,
        scenarios: row.scenarios,
        scenarios_done: row.scenarios_done,
        retries: row.retries,
        created_at: rfc3339(row.created_at),
        completed_at: row.completed_at.map(rfc3339),
    }
}
