//! Learning signals of a run's training groups, designed and ordinary ones. Table `learning_signals`.

use sqlx::{SqliteConnection, query};

use super::StoreError;

/// Sums over the groups of one kind, which fade.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SignalSums {
    /// Number of all groups.
    pub weight: f64,
    /// Success rates of the groups.
    pub success_sum: f64,
    /// Learning signals of the groups.
    pub signal_sum: f64,
    /// Squares of the learning signals.
    pub signal_sq_sum: f64,
}

/// Sums of both kinds of groups of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LearningSignalSums {
    /// Groups on ordinary proposals.
    pub ordinary: SignalSums,
    /// Groups on designed layouts.
    pub designed: SignalSums,
}

/// Reads the sums of a run; zeros before its first group.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get(conn: &mut SqliteConnection, run: &str) -> Result<LearningSignalSums, StoreError> {
    let mut sums = LearningSignalSums::default();
    let rows = query!(
        r#"SELECT is_designed AS "is_designed!: bool", weight, success_sum, signal_sum, signal_sq_sum
           FROM learning_signals WHERE run = ?"#,
        run
    )
    .fetch_all(conn)
    .await?;
    for row in rows {
        let kind = if row.is_designed { &mut sums.designed } else { &mut sums.ordinary };
        *kind = SignalSums {
            weight: row.weight,
            success_sum: row.success_sum,
            signal_sum: row.signal_sum,
            signal_sq_sum: row.signal_sq_sum,
        };
    }
    Ok(sums)
}

/// Replaces the sums of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn set(
    conn: &mut SqliteConnection,
    run: &str,
    sums: &LearningSignalSums,
) -> Result<(), StoreError> {
    for (is_designed, kind) in [(false, sums.ordinary), (true, sums.designed)] {
        query!(
            "INSERT OR REPLACE INTO learning_signals (run, is_designed, weight, success_sum, signal_sum, signal_sq_sum)
             VALUES (?, ?, ?, ?, ?, ?)",
            run,
            is_designed,
            kind.weight,
            kind.success_sum,
            kind.signal_sum,
            kind.signal_sq_sum
        )
        .execute(&mut *conn)
        .await?;
    }
    Ok(())
}
