//! Changes of a layout's state, with their history. Tables `layouts` and `layout_transitions`.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use super::layouts::{LayoutState, RetirementReason};
use crate::Millis;

/// A change of a layout's state.
#[derive(Debug, Clone)]
pub struct LayoutTransition {
    /// State after the transition.
    pub state: LayoutState,
    /// Why the layout is retired.
    pub retirement_reason: Option<RetirementReason>,
    /// Explanation of the transition as text.
    pub reason: String,
}

/// Changes the state of a layout, and adds a row to its history.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn change_state(
    conn: &mut SqliteConnection,
    id: i64,
    transition: &LayoutTransition,
    now: Millis,
) -> Result<(), StoreError> {
    let retired_at = (transition.state == LayoutState::Retired).then_some(now);
    query!(
        "UPDATE layouts SET state = ?, retirement_reason = ?, retired_at = ? WHERE id = ?",
        transition.state,
        transition.retirement_reason,
        retired_at,
        id
    )
    .execute(&mut *conn)
    .await?;
    query!(
        "INSERT INTO layout_transitions (layout, seq, state, reason, at)
         SELECT ?1, count(*), ?2, ?3, ?4 FROM layout_transitions WHERE layout = ?1",
        id,
        transition.state,
        transition.reason,
        now
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Row of the `layout_transitions` table, without its layout.
#[derive(Debug, Clone, PartialEq)]
pub struct TransitionRow {
    /// State after the transition.
    pub state: LayoutState,
    /// Explanation of the transition as text.
    pub reason: String,
    /// When the state changed.
    pub at: Millis,
}

/// Reads the changes of a layout's state, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn transitions(conn: &mut SqliteConnection, id: i64) -> Result<Vec<TransitionRow>, StoreError> {
    Ok(sqlx::query_as!(
        TransitionRow,
        r#"SELECT state AS "state: LayoutState", reason, at FROM layout_transitions WHERE layout = ? ORDER BY seq"#,
        id
    )
    .fetch_all(conn)
    .await?)
}
