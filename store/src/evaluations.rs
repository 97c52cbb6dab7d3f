//! Evaluations of policies on frozen suites, and the scenarios of each. Tables `evaluations` and `evaluation_scenarios`.

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{MAX_ROWS, StoreError, text_enum, to_json};
use crate::Millis;
use crate::principals::PrincipalId;

text_enum! {
    /// State of an evaluation.
    pub enum EvaluationState: "an evaluation's state" {
        /// A trainer leases and runs its scenarios.
        Open = "open",
        /// The server runs its scenarios.
        Running = "running",
        /// All of its scenarios were run.
        Complete = "complete",
        /// The evaluation was cancelled, or its policy cannot run.
        Failed = "failed",
    }
}

/// Row of the `evaluations` table.
#[derive(Debug, Clone, PartialEq)]
pub struct EvaluationRow {
    /// Number of the evaluation, from 1; 0 before it is stored.
    pub id: i64,
    /// Name that is displayed.
    pub name: String,
    /// Name of the suite.
    pub suite: String,
    /// Hash of the suite.
    pub suite_hash: String,
    /// Tasks of the suite that are run, as a JSON list; none for all.
    pub tasks: Option<String>,
    /// Name of the policy: a built-in one if there is no run.
    pub policy: String,
    /// Id of the run whose trainer runs the scenarios; none if the server does.
    pub run: Option<String>,
    /// Version of the run's policy.
    pub policy_version: Option<i64>,
    /// Common name of trainings that differ only in their seeds.
    pub training: Option<String>,
    /// Seed of this training among those.
    pub training_seed: Option<i64>,
    /// Episodes of each scenario.
    pub rollouts: i64,
    /// True if episodes of one scenario differ by random draws.
    pub is_stochastic: bool,
    /// Seed of a built-in policy that draws random numbers.
    pub seed: i64,
    /// State of the evaluation.
    pub state: EvaluationState,
    /// Why the evaluation failed.
    pub error: Option<String>,
    /// Number of its scenarios.
    pub scenarios: i64,
    /// Number of scenarios that were run.
    pub scenarios_done: i64,
    /// Number of times a scenario was offered again because its group was lost.
    pub retries: i64,
    /// When the evaluation started.
    pub created_at: Millis,
    /// When the last scenario was run.
    pub completed_at: Option<Millis>,
    /// Principal that started the evaluation; none without authentication.
    pub owner: Option<PrincipalId>,
}

/// A scenario of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EvaluationEntry {
    /// Number of the evaluation.
    pub evaluation: i64,
    /// Index of the scenario in its suite, from 0.
    pub entry: i64,
}

/// Episodes of one scenario of an evaluation.
#[derive(Debug, Clone, PartialEq)]
pub struct EntryEpisodes {
    /// Index of the scenario in its suite, from 0.
    pub entry: i64,
    /// Results of the episodes as JSON; none if they were not run yet.
    pub episodes: Option<String>,
    /// Number of the lease whose group runs the scenario; none if it waits, or if the server runs it.
    pub lease: Option<i64>,
    /// Random part of the id of that lease.
    pub id_suffix: Option<String>,
    /// Index of the group's first episode in the lease.
    pub first_number: Option<i64>,
}

/// Stores an evaluation with its scenarios, none of them run. Returns its number.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn insert(
    conn: &mut SqliteConnection,
    row: &EvaluationRow,
    entries: &[i64],
) -> Result<i64, StoreError> {
    let id = query!(
        "INSERT INTO evaluations (name, suite, suite_hash, tasks, policy, run, policy_version, training, training_seed,
                                  rollouts, is_stochastic, seed, state, scenarios, created_at, owner)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        row.name,
        row.suite,
        row.suite_hash,
        row.tasks,
        row.policy,
        row.run,
        row.policy_version,
        row.training,
        row.training_seed,
        row.rollouts,
        row.is_stochastic,
        row.seed,
        row.state,
        row.scenarios,
        row.created_at,
        row.owner
    )
    .execute(&mut *conn)
    .await?
    .last_insert_rowid();
    for rows in entries.chunks(MAX_ROWS) {
        let mut statement = QueryBuilder::new("INSERT INTO evaluation_scenarios (evaluation, entry) ");
        statement.push_values(rows, |mut values, entry| {
            values.push_bind(id).push_bind(*entry);
        });
        statement.build().execute(&mut *conn).await?;
    }
    Ok(id)
}

/// Selects [`EvaluationRow`]s: takes what follows `FROM evaluations` and the arguments of the statement.
macro_rules! query_evaluations {
    ($rest:literal, $($argument:expr),+ $(,)?) => {
        sqlx::query_as!(
            EvaluationRow,
            r#"SELECT id, name, suite, suite_hash, tasks, policy, run, policy_version, training, training_seed,
                      rollouts, is_stochastic AS "is_stochastic: bool", seed, state AS "state: EvaluationState", error, scenarios,
                      scenarios_done, retries, created_at, completed_at, owner AS "owner: PrincipalId"
               FROM evaluations "# + $rest,
            $($argument),+
        )
    };
}

/// Reads an evaluation.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get(conn: &mut SqliteConnection, id: i64) -> Result<Option<EvaluationRow>, StoreError> {
    Ok(query_evaluations!(
        "WHERE id = ? AND NOT EXISTS (SELECT 1 FROM runs r WHERE r.id = evaluations.run AND r.deleted_at IS NOT NULL)",
        id
    )
    .fetch_optional(conn).await?)
}

/// Reads evaluations with numbers below `before`, newest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn page(
    conn: &mut SqliteConnection,
    before: i64,
    limit: i64,
) -> Result<Vec<EvaluationRow>, StoreError> {
    Ok(query_evaluations!(
        "WHERE id < ? AND NOT EXISTS (SELECT 1 FROM runs r WHERE r.id = evaluations.run AND r.deleted_at IS NOT NULL)
         ORDER BY id DESC LIMIT ?",
        before,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the number of the oldest evaluation that the server has to run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn oldest_of_server(conn: &mut SqliteConnection) -> Result<Option<i64>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT id FROM evaluations WHERE state = 'running' ORDER BY id LIMIT 1")
        .fetch_optional(conn)
        .await?)
}

/// Counts the evaluations that are neither complete nor failed.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn count_unfinished(conn: &mut SqliteConnection) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM evaluations
           WHERE state IN ('open', 'running')
                 AND NOT EXISTS (SELECT 1 FROM runs r WHERE r.id = evaluations.run AND r.deleted_at IS NOT NULL)"#
    )
    .fetch_one(conn)
    .await?)
}

/// Reads the scenarios of an evaluation that are neither run nor leased, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn waiting(conn: &mut SqliteConnection, id: i64, limit: i64) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!(
        "SELECT entry FROM evaluation_scenarios
         WHERE evaluation = ? AND episodes IS NULL AND lease IS NULL ORDER BY entry LIMIT ?",
        id,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Assigns scenarios to the groups of a lease: the n-th scenario to the n-th group.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn assign(
    conn: &mut SqliteConnection,
    id: i64,
    lease: i64,
    entries: &[i64],
) -> Result<(), StoreError> {
    let entries = to_json(&entries)?;
    query!(
        "UPDATE evaluation_scenarios SET lease = ?, number = taken.key
         FROM json_each(?) AS taken WHERE evaluation = ? AND entry = taken.value",
        lease,
        entries,
        id
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the scenario that is assigned to a group.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_group(
    conn: &mut SqliteConnection,
    lease: i64,
    number: i64,
) -> Result<Option<EvaluationEntry>, StoreError> {
    Ok(sqlx::query_as!(
        EvaluationEntry,
        r#"SELECT evaluation AS "evaluation!: i64", entry AS "entry!: i64"
           FROM evaluation_scenarios INDEXED BY evaluation_scenarios_of_lease WHERE lease = ? AND number = ?"#,
        lease,
        number
    )
    .fetch_optional(conn)
    .await?)
}

/// Offers a scenario again, and counts that.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn offer_again(conn: &mut SqliteConnection, of: EvaluationEntry) -> Result<(), StoreError> {
    let offered = query!(
        "UPDATE evaluation_scenarios SET lease = NULL, number = NULL
         WHERE evaluation = ? AND entry = ? AND episodes IS NULL",
        of.evaluation,
        of.entry
    )
    .execute(&mut *conn)
    .await?;
    if offered.rows_affected() == 1 {
        query!("UPDATE evaluations SET retries = retries + 1 WHERE id = ?", of.evaluation)
            .execute(conn)
            .await?;
    }
    Ok(())
}

/// Stores the episodes of a scenario as JSON. The last scenario completes the evaluation, unless it was cancelled.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn store_episodes(
    conn: &mut SqliteConnection,
    of: EvaluationEntry,
    episodes: &str,
    now: Millis,
) -> Result<(), StoreError> {
    let done = query!(
        "UPDATE evaluation_scenarios SET episodes = ? WHERE evaluation = ? AND entry = ? AND episodes IS NULL",
        episodes,
        of.evaluation,
        of.entry
    )
    .execute(&mut *conn)
    .await?;
    if done.rows_affected() == 1 {
        query!(
            "UPDATE evaluations SET scenarios_done = scenarios_done + 1,
                 state = CASE WHEN scenarios_done + 1 >= scenarios AND state <> 'failed' THEN 'complete' ELSE state END,
                 completed_at = CASE WHEN scenarios_done + 1 >= scenarios AND state <> 'failed' THEN ?1 END
             WHERE id = ?2",
            now,
            of.evaluation
        )
        .execute(conn)
        .await?;
    }
    Ok(())
}

/// Fails an evaluation that cannot be run or was cancelled.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn fail(conn: &mut SqliteConnection, id: i64, error: &str) -> Result<(), StoreError> {
    query!("UPDATE evaluations SET state = 'failed', error = ? WHERE id = ?", error, id)
        .execute(conn)
        .await?;
    Ok(())
}

/// Reads the scenarios of an evaluation after an index, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn scenarios(
    conn: &mut SqliteConnection,
    id: i64,
    after: i64,
    limit: i64,
) -> Result<Vec<EntryEpisodes>, StoreError> {
    Ok(sqlx::query_as!(
        EntryEpisodes,
        r#"SELECT s.entry, s.episodes, l.id AS "lease?: i64", l.id_suffix AS "id_suffix?",
                  s.number * l.group_size AS "first_number?: i64"
           FROM evaluation_scenarios AS s LEFT JOIN leases AS l ON l.id = s.lease
           WHERE s.evaluation = ? AND s.entry > ? ORDER BY s.entry LIMIT ?"#,
        id,
        after,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads all scenarios of an evaluation, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn all_scenarios(conn: &mut SqliteConnection, id: i64) -> Result<Vec<EntryEpisodes>, StoreError> {
    scenarios(conn, id, -1, i64::MAX).await
}
