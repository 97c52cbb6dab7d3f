//! Filter of lists of runs, as conditions of a statement on `runs r` and its `run_totals t`.

use sqlx::{QueryBuilder, Sqlite};

use super::text_enum;
use crate::Millis;
use crate::run_tags::RunTag;
use crate::runs::{RunRow, RunStatus};

/// Filter of a list; a field that is none or empty filters nothing.
#[derive(Debug, Clone, Default)]
pub struct RunFilter {
    /// True for archived runs, false for the others.
    pub are_archived: bool,
    /// Tags of the run.
    pub tag: Option<TagFilter>,
    /// Strategy of the run.
    pub strategy: Option<String>,
    /// Ids of all tasks of the run in alphabetical order, separated by commas.
    pub tasks: Option<String>,
    /// Activity of the run.
    pub activity: Option<ActivityFilter>,
    /// Words that all occur in the id, the name, the note or a tag.
    pub words: Vec<String>,
}

/// Filter by the tags of a run.
#[derive(Debug, Clone)]
pub enum TagFilter {
    /// Runs with this tag.
    Tag(RunTag),
    /// Runs that have no tags.
    Untagged,
}

/// Filter by activity. Results since the moment `since` make a run count as running.
#[derive(Debug, Clone, Copy)]
pub struct ActivityFilter {
    /// Activity of the runs.
    pub activity: RunActivity,
    /// Time of the oldest results of a running run.
    pub since: Millis,
}

text_enum! {
    /// Activity of a run, by its status and its latest results.
    pub enum RunActivity: "a run's activity" {
        /// Active, and has no results yet.
        Waiting = "waiting",
        /// Active, and has recent results.
        Running = "running",
        /// Active, without recent results.
        Idle = "idle",
        /// Grants no leases, and is not archived.
        Paused = "paused",
        /// Paused and left out of lists.
        Archived = "archived",
    }
}

/// Returns the activity of a run. Results since the moment `since` make it count as running.
#[must_use]
pub fn activity_of(row: &RunRow, since: Millis) -> RunActivity {
    match (row.archived_at, row.status, row.last_results_at) {
        (Some(_), _, _) => RunActivity::Archived,
        (None, RunStatus::Paused, _) => RunActivity::Paused,
        (None, RunStatus::Active, None) => RunActivity::Waiting,
        (None, RunStatus::Active, Some(at)) if at >= since => RunActivity::Running,
        (None, RunStatus::Active, Some(_)) => RunActivity::Idle,
    }
}

/// Appends the conditions of the filter.
pub(super) fn push_filter(statement: &mut QueryBuilder<Sqlite>, filter: &RunFilter) {
    let RunFilter { are_archived, tag, strategy, tasks, activity, words } = filter.clone();
    statement.push(" WHERE r.deleted_at IS NULL AND r.archived_at IS ");
    statement.push(if are_archived { "NOT NULL" } else { "NULL" });
    match tag {
        Some(TagFilter::Tag(tag)) => {
            statement.push(" AND r.id IN (SELECT run FROM run_tags WHERE tag = ");
            statement.push_bind(tag.to_string()).push(")");
        }
        Some(TagFilter::Untagged) => {
            statement.push(" AND NOT EXISTS (SELECT 1 FROM run_tags WHERE run = r.id)");
        }
        None => {}
    }
    if let Some(strategy) = strategy {
        statement.push(" AND r.strategy = ").push_bind(strategy);
    }
    if let Some(tasks) = tasks {
        statement.push(" AND r.tasks = ").push_bind(tasks);
    }
    if let Some(activity) = activity {
        push_activity(statement, activity);
    }
    for word in words {
        let pattern = like_pattern(&word);
        for (before, column) in [(" AND (", "r.id"), (" OR ", "r.name"), (" OR ", "r.note")] {
            statement.push(before).push(column).push(" LIKE ");
            statement.push_bind(pattern.clone()).push(" ESCAPE '\\'");
        }
        statement.push(" OR EXISTS (SELECT 1 FROM run_tags WHERE run = r.id AND tag LIKE ");
        statement.push_bind(pattern).push(" ESCAPE '\\'))");
    }
}

fn push_activity(statement: &mut QueryBuilder<Sqlite>, filter: ActivityFilter) {
    match filter.activity {
        RunActivity::Archived => statement.push(" AND r.archived_at IS NOT NULL"),
        RunActivity::Paused => statement.push(" AND r.archived_at IS NULL AND r.status = 'paused'"),
        RunActivity::Waiting => statement.push(" AND r.status = 'active' AND t.last_results_at IS NULL"),
        RunActivity::Running => {
            statement.push(" AND r.status = 'active' AND t.last_results_at >= ").push_bind(filter.since)
        }
        RunActivity::Idle => {
            statement.push(" AND r.status = 'active' AND t.last_results_at < ").push_bind(filter.since)
        }
    };
}

/// Pattern of the texts that contain a word, for `LIKE … ESCAPE '\'`.
fn like_pattern(word: &str) -> String {
    let mut pattern = String::with_capacity(word.len() + 2);
    pattern.push('%');
    for c in word.chars() {
        if matches!(c, '%' | '_' | '\\') {
            pattern.push('\\');
        }
        pattern.push(c);
    }
    pattern.push('%');
    pattern
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pattern_matches_a_word_literally() {
        assert_eq!(like_pattern("50%_\\"), r"%50\%\_\\%");
    }
}
