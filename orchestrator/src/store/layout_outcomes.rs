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
    pub score: f64,
    /// Sum of the regrets.
    pub regret: f64,
    /// Success rates of the last outcomes, including this one, as JSON.
    pub recent: String,
    /// Consecutive outcomes without a success, including this one.
    pub barren: i64,
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
        "UPDATE layouts SET outcomes = outcomes + 1, episodes = episodes + ?, successes = successes + ?, score = score + ?,
             regret = regret + ?, recent = ?, barren = ? WHERE id = ?",
        outcome.episodes,
        outcome.successes,
        outcome.score,
        outcome.regret,
        outcome.recent,
        outcome.barren,
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
pub async fn add_faults(
    conn: &mut SqliteConnection,
    id: i64,
    episodes: &[BTreeSet<&str>],
) -> Result<(), StoreError> {
    let aim =
        sqlx::query_scalar!("SELECT mode FROM layouts WHERE id = ?", id).fetch_optional(&mut *conn).await?;
    let aimed = |modes: &&BTreeSet<&str>| aim.iter().flatten().any(|aim| modes.contains(aim.as_str()));
    let (faults, as_aimed) = (episodes.len() as i64, episodes.iter().filter(aimed).count() as i64);
    query!(
        "UPDATE layouts SET faults = faults + ?, as_aimed = as_aimed + ? WHERE id = ?",
        faults,
        as_aimed,
        id
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Replaces the last outcomes of a layout.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn reset_recent(conn: &mut SqliteConnection, id: i64, recent: &str) -> Result<(), StoreError> {
    query!("UPDATE layouts SET recent = ?, barren = 0 WHERE id = ?", recent, id).execute(conn).await?;
    Ok(())
}
