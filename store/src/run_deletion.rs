//! Deletion of runs: a run is marked as deleted, and its rows are deleted in small steps. Column `runs.deleted_at`, and all tables
//! with rows of runs.
//!
//! Scenarios and recipes are shared by runs: those that nothing refers to any more are deleted with the rows that referred to them.

use sqlx::{Row, SqliteConnection, query};

use super::{StoreError, gc};
use crate::Millis;

/// Rows that one step deletes at most. Rows with a large body count as several.
const ROWS_PER_STEP: i64 = 256;

/// Selects the first rows of a table with a column `run`. Rows of other tables refer to them.
macro_rules! first_of_run {
    ($table:literal) => {
        concat!("(SELECT id AS of_id FROM ", $table, " WHERE run = ?1 ORDER BY run, id LIMIT 32) AS parents")
    };
}

/// Deletes up to `?2` rows of a table with a column `run`.
macro_rules! of_run {
    ($table:literal, $key:literal) => {
        concat!(
            "DELETE FROM ",
            $table,
            " WHERE (",
            $key,
            ") IN (SELECT ",
            $key,
            " FROM ",
            $table,
            " WHERE run = ?1 LIMIT ?2)"
        )
    };
}

/// Deletes up to `?2` rows of a table that refer to the first rows of a parent table.
macro_rules! of_first {
    ($parent:literal, $table:literal, $column:literal, $key:literal) => {
        concat!(
            "DELETE FROM ",
            $table,
            " WHERE (",
            $key,
            ") IN (SELECT ",
            $key,
            " FROM ",
            first_of_run!($parent),
            " CROSS JOIN ",
            $table,
            " ON ",
            $table,
            ".",
            $column,
            " = parents.of_id LIMIT ?2)"
        )
    };
}

/// Deletes up to `?2` of the first rows of a table.
macro_rules! first {
    ($table:literal) => {
        concat!(
            "DELETE FROM ",
            $table,
            " WHERE id IN (SELECT of_id FROM ",
            first_of_run!($table),
            " LIMIT ?2)"
        )
    };
}

/// Shared rows that the deleted rows referred to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shared {
    None,
    /// The statement returns the ids of scenarios.
    Scenarios,
    /// The statement returns the ids of recipes.
    Recipes,
}

/// A statement that deletes rows of a run.
#[derive(Debug, Clone, Copy)]
struct Deletion {
    statement: &'static str,
    /// Number of rows that one row counts as.
    weight: i64,
    shared: Shared,
    /// True if the rows of other tables that refer to the next rows must be deleted before the next rows.
    has_children: bool,
}

impl Deletion {
    const fn new(statement: &'static str) -> Self {
        Self { statement, weight: 1, shared: Shared::None, has_children: false }
    }

    const fn weight(self, weight: i64) -> Self {
        Self { weight, ..self }
    }

    const fn shared(self, shared: Shared) -> Self {
        Self { shared, ..self }
    }

    const fn has_children(self) -> Self {
        Self { has_children: true, ..self }
    }

    /// Deletes up to `limit` rows of a run. Returns their number.
    async fn execute(self, conn: &mut SqliteConnection, run: &str, limit: i64) -> Result<i64, StoreError> {
        let statement = query(self.statement).bind(run).bind(limit);
        if self.shared == Shared::None {
            return Ok(statement.execute(conn).await?.rows_affected().cast_signed());
        }
        let rows = statement.fetch_all(&mut *conn).await?;
        let ids = rows.iter().map(|row| row.try_get::<Option<Vec<u8>>, _>(0));
        let ids: Vec<Vec<u8>> = ids.filter_map(Result::transpose).collect::<Result<_, _>>()?;
        match self.shared {
            Shared::Recipes => gc::delete_recipes(conn, &ids).await?,
            Shared::Scenarios | Shared::None => gc::delete_scenarios(conn, &ids).await?,
        }
        Ok(rows.len() as i64)
    }
}

/// Statements that delete all rows of a run, in the order that references between tables demand.
const DELETIONS: &[Deletion] = &[
    Deletion::new(of_run!("trajectory_groups", "id")).weight(64),
    Deletion::new(of_run!("run_warnings", "id")),
    Deletion::new(of_run!("alerts", "id")),
    Deletion::new(of_first!("failure_cells", "failure_examples", "cell", "cell, slot")),
    Deletion::new(first!("failure_cells")).has_children(),
    Deletion::new(of_run!("failure_inertial_sectors", "run, task, mode, sector")),
    Deletion::new(of_run!("compacted_leases", "id")).weight(8),
    Deletion::new(of_first!("leases", "critique_queue", "lease", "id")),
    Deletion::new(of_first!("leases", "action_logs", "lease", "id")),
    Deletion::new(of_first!("leases", "episodes", "lease", "lease, number")),
    Deletion::new(of_first!("leases", "audited_scores", "lease", "lease, number")),
    Deletion::new(of_first!("leases", "column_claims", "lease", "lease")).weight(64),
    Deletion::new(concat!(of_first!("leases", "seed_ranges", "lease", "lease, number"), " RETURNING recipe"))
        .weight(2)
        .shared(Shared::Recipes),
    Deletion::new(of_first!("leases", "rollout_leases", "lease", "lease")),
    Deletion::new(concat!(
        of_first!("leases", "audit_samples", "lease", "lease, number"),
        " RETURNING scenario"
    ))
    .weight(2)
    .shared(Shared::Scenarios),
    Deletion::new(concat!(of_first!("leases", "groups", "lease", "lease, number"), " RETURNING scenario"))
        .weight(2)
        .shared(Shared::Scenarios),
    Deletion::new(first!("leases")).has_children(),
    Deletion::new(of_first!("layouts", "layout_transitions", "layout", "layout, seq")),
    Deletion::new(concat!(first!("layouts"), " RETURNING scenario"))
        .weight(4)
        .shared(Shared::Scenarios)
        .has_children(),
    Deletion::new(of_run!("design_requests", "id")).weight(4),
    Deletion::new(of_run!("gate_counts", "run, task, verdict")),
    Deletion::new(of_run!("learning_signals", "run, is_designed")),
    Deletion::new(of_first!("evaluations", "evaluation_scenarios", "evaluation", "evaluation, entry")),
    Deletion::new(first!("evaluations")).has_children(),
    Deletion::new(concat!(of_run!("proposals", "run, seq"), " RETURNING scenario"))
        .weight(2)
        .shared(Shared::Scenarios),
    Deletion::new(of_run!("curriculum_snapshots", "run, seq")).weight(64),
    Deletion::new(of_run!("curriculum_events", "run, seq")),
    Deletion::new(of_run!("level_moves", "run, seq, task")),
    Deletion::new(of_run!("critique_counters", "run, task")),
    Deletion::new(of_run!("task_counters", "run, task, level, is_designed")),
    Deletion::new(of_run!("claim_counters", "run, task, level")),
    Deletion::new(of_run!("group_counters", "run, task, level")),
    Deletion::new(of_run!("policy_versions", "run, version")),
    Deletion::new(of_run!("policy_version_counters", "run, version, task")),
    Deletion::new(of_run!("task_history", "run, task, width, start")),
    Deletion::new(of_run!("task_curves", "run, task, ordinal")),
    Deletion::new(of_run!("task_curve_blocks", "run, task, block")).weight(16),
    Deletion::new(of_run!("task_history_params", "run, task, width, start, param")),
    Deletion::new(of_run!("task_history_rungs", "run, task, width, start, start_rung, level")),
    Deletion::new(of_run!("step_verdicts", "id")),
    Deletion::new(of_run!("rollout_spend", "run, day")),
    Deletion::new(of_run!("run_policies", "run")),
    Deletion::new(of_run!("run_events", "id")),
    Deletion::new(of_run!("deleted_run_events", "run")),
    Deletion::new(of_run!("run_settings", "run, revision")),
    Deletion::new(of_run!("run_tags", "run, tag")),
    Deletion::new(of_run!("run_totals", "run")),
    Deletion::new(of_run!("trainer_metrics", "run, name, step")),
    Deletion::new(of_run!("trainer_metric_names", "run, name")),
    Deletion::new(of_run!("run_members", "run, principal")),
];

/// Marks a run as deleted, and ends what workers and clients do for it: its leases, its waiting proposals and its design requests.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn mark(conn: &mut SqliteConnection, run: &str, now: Millis) -> Result<(), StoreError> {
    query!(
        "INSERT INTO highest_deleted_lease (id, lease) SELECT 1, coalesce(max(id), 0) FROM leases WHERE true
         ON CONFLICT (id) DO UPDATE SET lease = max(lease, excluded.lease)"
    )
    .execute(&mut *conn)
    .await?;
    query!(
        "DELETE FROM rollout_leases WHERE lease IN (
             SELECT id FROM leases INDEXED BY leases_active WHERE run = ? AND status = 'active')",
        run
    )
    .execute(&mut *conn)
    .await?;
    query!(
        "UPDATE leases INDEXED BY leases_active SET status = 'released' WHERE run = ? AND status = 'active'",
        run
    )
    .execute(&mut *conn)
    .await?;
    query!(
        "UPDATE proposals INDEXED BY proposals_waiting SET state = 'dropped'
         WHERE run = ? AND state IN ('proposed', 'prepared')",
        run
    )
    .execute(&mut *conn)
    .await?;
    query!(
        "UPDATE design_requests SET state = 'failed', error = 'the run was deleted', ended_at = ?
         WHERE run = ? AND state IN ('waiting', 'running')",
        now,
        run
    )
    .execute(&mut *conn)
    .await?;
    query!("UPDATE runs SET deleted_at = ? WHERE id = ?", now, run).execute(conn).await?;
    Ok(())
}

/// Reads the id of the run that was marked first of those with rows left.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn oldest_pending(conn: &mut SqliteConnection) -> Result<Option<String>, StoreError> {
    Ok(sqlx::query_scalar!(
        "SELECT id FROM runs WHERE deleted_at IS NOT NULL ORDER BY deleted_at, id LIMIT 1"
    )
    .fetch_optional(conn)
    .await?)
}

/// Deletes some rows of a run that was marked. The row in `runs` is the last one. Returns true if rows are left.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn delete_rows(conn: &mut SqliteConnection, run: &str) -> Result<bool, StoreError> {
    let mut rows_left = ROWS_PER_STEP;
    for deletion in DELETIONS {
        let limit = (rows_left / deletion.weight).max(1);
        let deleted = deletion.execute(conn, run, limit).await?;
        rows_left -= deleted * deletion.weight;
        if deleted >= limit || rows_left <= 0 || (deletion.has_children && deleted > 0) {
            return Ok(true);
        }
    }
    query!("DELETE FROM runs WHERE id = ? AND deleted_at IS NOT NULL", run).execute(conn).await?;
    Ok(false)
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;

    /// Returns the table that a statement deletes from.
    fn table(deletion: &Deletion) -> &'static str {
        deletion.statement.split(' ').nth(2).expect("DELETE FROM table")
    }

    async fn empty_database(folder: &tempfile::TempDir) -> SqliteConnection {
        crate::open_writer(&folder.path().join("db")).await.expect("a database")
    }

    /// Returns the tables that each table refers to.
    async fn references(conn: &mut SqliteConnection) -> BTreeMap<String, BTreeSet<String>> {
        let rows = sqlx::query_as::<_, (String, Option<String>)>(
            "SELECT s.name, f.\"table\" FROM sqlite_schema s LEFT JOIN pragma_foreign_key_list(s.name) f
             WHERE s.type = 'table'",
        );
        let mut references = BTreeMap::<String, BTreeSet<String>>::new();
        for (name, parent) in rows.fetch_all(conn).await.expect("the schema") {
            references.entry(name).or_default().extend(parent);
        }
        references
    }

    /// Finds the tables with rows of runs in the schema: those with a column `run` or `lease`, and those that refer to one.
    #[tokio::test]
    async fn rows_of_all_tables_of_runs_are_deleted() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut conn = empty_database(&folder).await;
        let with_key = sqlx::query_scalar::<_, String>(
            "SELECT DISTINCT s.name FROM sqlite_schema s JOIN pragma_table_info(s.name) c
             WHERE s.type = 'table' AND c.name IN ('run', 'lease')",
        );
        let mut of_runs: BTreeSet<String> =
            with_key.fetch_all(&mut conn).await.expect("the schema").into_iter().collect();
        // This table has an id of a lease, but belongs to no run.
        assert!(of_runs.remove("highest_deleted_lease"));
        let references = references(&mut conn).await;
        loop {
            let refers = |parents: &BTreeSet<String>| parents.iter().any(|parent| of_runs.contains(parent));
            let found: Vec<String> = references
                .iter()
                .filter(|(name, parents)| !of_runs.contains(*name) && refers(parents))
                .map(|(name, _)| name.clone())
                .collect();
            if found.is_empty() {
                break;
            }
            of_runs.extend(found);
        }
        let deleted: BTreeSet<String> = DELETIONS.iter().map(|deletion| table(deletion).to_owned()).collect();
        assert_eq!(deleted, of_runs);
        assert_eq!(deleted.len(), DELETIONS.len(), "each table is deleted from once");
        // Rows are deleted before the rows that they refer to.
        for (at, deletion) in DELETIONS.iter().enumerate() {
            for later in &DELETIONS[at + 1..] {
                let name = table(deletion);
                assert!(!references[table(later)].contains(name), "{} refers to {name}", table(later));
            }
        }
    }

    #[tokio::test]
    async fn no_statement_reads_rows_of_other_runs() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut conn = empty_database(&folder).await;
        for deletion in DELETIONS {
            let statement = deletion.statement;
            let plan = sqlx::query(sqlx::AssertSqlSafe(format!("EXPLAIN QUERY PLAN {statement}")));
            for step in plan.fetch_all(&mut conn).await.expect("a plan") {
                let step: String = step.get("detail");
                assert!(!step.starts_with("SCAN ") || step == "SCAN parents", "{statement}: {step}");
            }
        }
    }
}
