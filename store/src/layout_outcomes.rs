//! Outcomes of the groups on a layout, added to its row. Table `layouts`.

use std::collections::BTreeSet;

use sqlx::{SqliteConnection, query};

use super::StoreError;

/// Outcome of a group on a layout.
#[derive(Debug, Clone)]
pub struct LayoutOutcome {
    /// Number of finished episodes.
    pub episodes: i64,
    /// Finished episodes that succeeded.
    pub successes: i64,
    /// Sum of the scores.
    pub score_sum: f64,
    /// Sum of the regrets.
    pub regret_sum: f64,
    /// Results of the last groups, including this one, as JSON.
    pub recent_results: String,
}

/// Adds an outcome to a layout.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add_outcome(
    conn: &mut SqliteConnection,
    id: i64,
    outcome: &LayoutOutcome,
) -> Result<(), StoreError> {
    query!(
        "UPDATE layouts SET outcomes = outcomes + 1, episodes = episodes + ?, successes = successes + ?,
             score_sum = score_sum + ?, regret_sum = regret_sum + ?, recent_results = ? WHERE id = ?",
        outcome.episodes,
        outcome.successes,
        outcome.score_sum,
        outcome.regret_sum,
        outcome.recent_results,
        id
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Counts criticised episodes with failures on a layout: one entry an episode, with its failure modes.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn add_failure_episodes(
    conn: &mut SqliteConnection,
    id: i64,
    episodes: &[BTreeSet<&str>],
) -> Result<(), StoreError> {
    let aim =
        sqlx::query_scalar!("SELECT mode FROM layouts WHERE id = ?", id).fetch_optional(&mut *conn).await?;
    let aimed = |modes: &&BTreeSet<&str>| aim.iter().flatten().any(|aim| modes.contains(aim.as_str()));
    let (with_failure, with_aimed_failure) =
        (episodes.len() as i64, episodes.iter().filter(aimed).count() as i64);
    query!(
        "UPDATE layouts SET failure_episodes = failure_episodes + ?, aimed_failure_episodes = aimed_failure_episodes + ?
         WHERE id = ?",
        with_failure,
        with_aimed_failure,
        id
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Forgets the results of the last groups on a layout.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn forget_results(conn: &mut SqliteConnection, id: i64) -> Result<(), StoreError> {
    query!("UPDATE layouts SET recent_results = '[]' WHERE id = ?", id).execute(conn).await?;
    Ok(())
}
