//! Read models: questions about runs that the API, the metrics and the reports ask. Nothing here writes.
//!
//! Questions that need a run in memory are [`crate::engine::change::Query`]s, answered by the writer.

pub mod mastery_gauges;
pub mod run_progress;
pub mod standing;
pub mod task_levels;
