//! Read models of runs for the API, the metrics and the reports. Nothing here writes.
//!
//! Queries that need a run in memory implement [`crate::engine::change::StateQuery`] and run in the writer.

pub mod current_mastery;
pub mod mastery_gauges;
pub mod run_progress;
pub mod run_series;
pub mod samplers;
pub mod task_levels;
