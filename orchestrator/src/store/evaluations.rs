//! What policies did on frozen suites.

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{ROWS, StoreError, to_json};
use crate::clock::Millis;

/// An evaluation as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct EvaluationRow {
    /// Its number; 0 before it has one.
    pub id: i64,
    /// Its name for people.
    pub name: String,
    /// The suite.
    pub suite: String,
    /// Its hash.
    pub suite_hash: String,
    /// The tasks of it that are flown, as JSON; none: all.
    pub tasks: Option<String>,
    /// The policy: a built-in one where there is no run.
    pub policy: String,
    /// Whose trainer flies it; none: the server does.
    pub run: Option<String>,
    /// The version of the run's policy.
    pub version: Option<i64>,
    /// What trainings of one kind are called together.
    pub training: Option<String>,
    /// By what this one differs from them.
    pub training_seed: Option<i64>,
    /// Episodes of each scenario.
    pub rollouts: i64,
    /// Whether these differ by chance.
    pub chance: i64,
    /// What a built-in policy with chance in it draws from.
    pub seed: i64,
    /// `open`, `flying`, `complete` or `failed`.
    pub state: String,
    /// Why it failed.
    pub trouble: Option<String>,
    /// Scenarios.
    pub scenarios: i64,
    /// Scenarios that are flown.
    pub flown: i64,
    /// How often scenarios were offered again because the groups that flew them came to nothing.
    pub reflown: i64,
    /// When it was begun.
    pub created_at: Millis,
    /// When the last scenario was flown.
    pub completed_at: Option<Millis>,
}

/// Begins an evaluation, with its scenarios, at these places of the suite, unflown: its number.
///
/// # Errors
/// The database's.
pub async fn insert(
    conn: &mut SqliteConnection,
    row: &EvaluationRow,
    entries: &[i64],
) -> Result<i64, StoreError> {
    let id = query!(
        "INSERT INTO evaluations (name, suite, suite_hash, tasks, policy, run, version, training, training_seed, rollouts,
                                  chance, seed, state, scenarios, created_at)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        row.name,
        row.suite,
        row.suite_hash,
        row.tasks,
        row.policy,
        row.run,
        row.version,
        row.training,
        row.training_seed,
        row.rollouts,
        row.chance,
        row.seed,
        row.state,
        row.scenarios,
        row.created_at
    )
    .execute(&mut *conn)
    .await?
    .last_insert_rowid();
    for rows in entries.chunks(ROWS) {
        let mut statement = QueryBuilder::new("INSERT INTO evaluation_scenarios (evaluation, entry) ");
        statement.push_values(rows, |mut values, entry| {
            values.push_bind(id).push_bind(*entry);
        });
        statement.build().execute(&mut *conn).await?;
    }
    Ok(id)
}

/// An evaluation.
///
/// # Errors
/// The database's.
pub async fn get(conn: &mut SqliteConnection, id: i64) -> Result<Option<EvaluationRow>, StoreError> {
    Ok(sqlx::query_as!(
        EvaluationRow,
        "SELECT id, name, suite, suite_hash, tasks, policy, run, version, training, training_seed, rollouts, chance, seed, state,
                trouble, scenarios, flown, reflown, created_at, completed_at
         FROM evaluations WHERE id = ?",
        id
    )
    .fetch_optional(conn)
    .await?)
}

/// Evaluations below a number, the newest first.
///
/// # Errors
/// The database's.
pub async fn below(
    conn: &mut SqliteConnection,
    before: i64,
    limit: i64,
) -> Result<Vec<EvaluationRow>, StoreError> {
    Ok(sqlx::query_as!(
        EvaluationRow,
        "SELECT id, name, suite, suite_hash, tasks, policy, run, version, training, training_seed, rollouts, chance, seed, state,
                trouble, scenarios, flown, reflown, created_at, completed_at
         FROM evaluations WHERE id < ? ORDER BY id DESC LIMIT ?",
        before,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// The oldest evaluation that the server is to fly.
///
/// # Errors
/// The database's.
pub async fn flying(conn: &mut SqliteConnection) -> Result<Option<i64>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT id FROM evaluations WHERE state = 'flying' ORDER BY id LIMIT 1")
        .fetch_optional(conn)
        .await?)
}

/// How many are not complete.
///
/// # Errors
/// The database's.
pub async fn unfinished(conn: &mut SqliteConnection) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM evaluations WHERE state IN ('open', 'flying')"#
    )
    .fetch_one(conn)
    .await?)
}

/// Places of scenarios that nobody flies, in order.
///
/// # Errors
/// The database's.
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

/// Says which groups of a lease fly which scenarios: the n-th group the n-th of these places.
///
/// # Errors
/// The database's.
pub async fn leased(
    conn: &mut SqliteConnection,
    (id, lease): (i64, i64),
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

/// Which evaluation's scenario a group flies: its number and the place.
///
/// # Errors
/// The database's.
pub async fn of_group(
    conn: &mut SqliteConnection,
    lease: i64,
    number: i64,
) -> Result<Option<(i64, i64)>, StoreError> {
    let row = query!(
        r#"SELECT evaluation AS "evaluation!: i64", entry AS "entry!: i64"
           FROM evaluation_scenarios INDEXED BY evaluation_scenarios_of_lease WHERE lease = ? AND number = ?"#,
        lease,
        number
    )
    .fetch_optional(conn)
    .await?;
    Ok(row.map(|row| (row.evaluation, row.entry)))
}

/// Offers a scenario again, and counts that.
///
/// # Errors
/// The database's.
pub async fn offer_again(conn: &mut SqliteConnection, id: i64, entry: i64) -> Result<(), StoreError> {
    let offered = query!(
        "UPDATE evaluation_scenarios SET lease = NULL, number = NULL
         WHERE evaluation = ? AND entry = ? AND episodes IS NULL",
        id,
        entry
    )
    .execute(&mut *conn)
    .await?;
    if offered.rows_affected() == 1 {
        query!("UPDATE evaluations SET reflown = reflown + 1 WHERE id = ?", id).execute(conn).await?;
    }
    Ok(())
}

/// Writes the episodes of a scenario, as JSON, and completes the evaluation with the last of them, unless it was given up before.
///
/// # Errors
/// The database's.
pub async fn flown(
    conn: &mut SqliteConnection,
    (id, entry): (i64, i64),
    episodes: &str,
    now: Millis,
) -> Result<(), StoreError> {
    let done = query!(
        "UPDATE evaluation_scenarios SET episodes = ? WHERE evaluation = ? AND entry = ? AND episodes IS NULL",
        episodes,
        id,
        entry
    )
    .execute(&mut *conn)
    .await?;
    if done.rows_affected() == 1 {
        query!(
            "UPDATE evaluations SET flown = flown + 1,
                 state = CASE WHEN flown + 1 >= scenarios AND state <> 'failed' THEN 'complete' ELSE state END,
                 completed_at = CASE WHEN flown + 1 >= scenarios AND state <> 'failed' THEN ?1 END
             WHERE id = ?2",
            now,
            id
        )
        .execute(conn)
        .await?;
    }
    Ok(())
}

/// Ends one that cannot be flown.
///
/// # Errors
/// The database's.
pub async fn fail(conn: &mut SqliteConnection, id: i64, trouble: &str) -> Result<(), StoreError> {
    query!("UPDATE evaluations SET state = 'failed', trouble = ? WHERE id = ?", trouble, id)
        .execute(conn)
        .await?;
    Ok(())
}

/// Places behind `after` with the episodes of their scenarios, as JSON; none where they are not flown.
///
/// # Errors
/// The database's.
pub async fn page(
    conn: &mut SqliteConnection,
    id: i64,
    after: i64,
    limit: i64,
) -> Result<Vec<(i64, Option<String>)>, StoreError> {
    let rows = query!(
        "SELECT entry, episodes FROM evaluation_scenarios WHERE evaluation = ? AND entry > ? ORDER BY entry LIMIT ?",
        id,
        after,
        limit
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (row.entry, row.episodes)).collect())
}

/// The places of the suite that are flown, in order, each with the episodes there as JSON; none where they are not flown yet.
///
/// # Errors
/// The database's.
pub async fn episodes(
    conn: &mut SqliteConnection,
    id: i64,
) -> Result<Vec<(i64, Option<String>)>, StoreError> {
    page(conn, id, -1, i64::MAX).await
}
