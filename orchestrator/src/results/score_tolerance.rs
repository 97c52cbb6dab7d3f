//! When two scores of a task count as equal.

use env_core::space::ScoreRange;

/// Largest difference of two scores of a task that count as equal: see [`ScoreRange::tolerance`].
pub(crate) fn score_tolerance(task: &str) -> f64 {
    env_core::task(task).map_or(ScoreRange::EQUAL_SHARE, |task| task.score_range().tolerance())
}
