//! Run of a comparison with what the database has of it.

use std::collections::BTreeMap;

use orchestrator::evaluations::read::LoadedEvaluation;
use orchestrator::queries::run_series::SeriesPoint;
use serde_json::Value;
use store::runs::RunRow;

/// Run of a comparison.
pub(super) struct ComparedRun {
    /// Row of the run.
    pub(super) row: RunRow,
    /// Settings of the run.
    pub(super) settings: Value,
    /// Number of finished episodes.
    pub(super) episodes: i64,
    /// Points of each task.
    pub(super) points: BTreeMap<String, Vec<SeriesPoint>>,
    /// Newest evaluation of the highest policy version on each suite.
    pub(super) evaluations: Vec<LoadedEvaluation>,
}
