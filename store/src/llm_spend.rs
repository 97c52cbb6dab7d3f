//! Tokens and cost that language models took, by run and day. The budgets of the server start from these sums.

use sqlx::SqliteConnection;

use super::StoreError;

/// Tokens and cost of one run on one day.
#[derive(Debug, Clone, PartialEq)]
pub struct LlmSpendRow {
    /// Id of the run; empty where no run is involved.
    pub run: String,
    /// Days since 1970-01-01 UTC.
    pub day: i64,
    /// Tokens, prompts and completions together.
    pub tokens: i64,
    /// Cost in the currency of the configured prices.
    pub cost: f64,
}

/// Reads what design requests spent, by run and day.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_designs(conn: &mut SqliteConnection) -> Result<Vec<LlmSpendRow>, StoreError> {
    Ok(sqlx::query_as!(
        LlmSpendRow,
        r#"SELECT run AS "run!", created_at / 86400000 AS "day!: i64", sum(tokens_in + tokens_out) AS "tokens!: i64",
                  sum(cost) AS "cost!: f64"
           FROM design_requests WHERE designer = 'llm' GROUP BY run, created_at / 86400000 ORDER BY run"#
    )
    .fetch_all(conn)
    .await?)
}

/// Reads what rollouts of chat policies spent, by run and day.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_rollouts(conn: &mut SqliteConnection) -> Result<Vec<LlmSpendRow>, StoreError> {
    Ok(sqlx::query_as!(
        LlmSpendRow,
        r#"SELECT run, day, tokens_in + tokens_out AS "tokens!: i64", cost FROM rollout_spend ORDER BY run, day"#
    )
    .fetch_all(conn)
    .await?)
}

/// Reads what the judge of steps spent, by run and day.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_judge(conn: &mut SqliteConnection) -> Result<Vec<LlmSpendRow>, StoreError> {
    Ok(sqlx::query_as!(
        LlmSpendRow,
        r#"SELECT coalesce(run, '') AS "run!: String", at / 86400000 AS "day!: i64",
                  sum(tokens_in + tokens_out) AS "tokens!: i64", sum(cost) AS "cost!: f64"
           FROM step_verdicts GROUP BY run, at / 86400000 ORDER BY run"#
    )
    .fetch_all(conn)
    .await?)
}
