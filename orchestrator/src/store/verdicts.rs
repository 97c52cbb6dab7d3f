//! What a language model said of single steps, beside what the rules say.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use super::asks::SpentRow;
use crate::clock::Millis;

/// A verdict as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct VerdictRow {
    /// The run; none where nobody flew for one.
    pub run: Option<String>,
    /// What the episode is called.
    pub episode: String,
    /// The scenario's digest.
    pub scenario: Vec<u8>,
    /// The task.
    pub task: String,
    /// Counted from 1.
    pub step: i64,
    /// The model.
    pub model: String,
    /// The version of the words it was asked with.
    pub prompt: String,
    /// What it says; none where it said nothing.
    pub score: Option<f64>,
    /// Why.
    pub reasoning: Option<String>,
    /// Why it said nothing.
    pub error: Option<String>,
    /// What the rules say; none where a single step counts for nothing.
    pub rule_score: Option<f64>,
    /// Which of their cases it is.
    pub rule_case: Option<String>,
    /// The same was asked before.
    pub cached: bool,
    /// Tokens read.
    pub tokens_in: i64,
    /// Tokens written.
    pub tokens_out: i64,
    /// What they cost.
    pub cost: f64,
    /// How long it took.
    pub latency_ms: i64,
}

/// Keeps one.
///
/// # Errors
/// The database's.
pub async fn insert(conn: &mut SqliteConnection, row: &VerdictRow, at: Millis) -> Result<(), StoreError> {
    query!(
        "INSERT INTO judge_verdicts (at, run, episode, scenario, task, step, model, prompt, score, reasoning, error,
                                     rule_score, rule_case, cached, tokens_in, tokens_out, cost, latency_ms)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        at,
        row.run,
        row.episode,
        row.scenario,
        row.task,
        row.step,
        row.model,
        row.prompt,
        row.score,
        row.reasoning,
        row.error,
        row.rule_score,
        row.rule_case,
        row.cached,
        row.tokens_in,
        row.tokens_out,
        row.cost,
        row.latency_ms
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Whether this database keeps verdicts at all.
///
/// # Errors
/// The database's.
pub async fn are_kept(conn: &mut SqliteConnection) -> Result<bool, StoreError> {
    let found = sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM sqlite_schema WHERE type = 'table' AND name = 'judge_verdicts'"#
    );
    Ok(found.fetch_one(conn).await? > 0)
}

/// What was said of steps, without the words.
#[derive(Debug, Clone, PartialEq)]
pub struct SaidRow {
    /// The task.
    pub task: String,
    /// The model.
    pub model: String,
    /// What it says; none where it said nothing.
    pub score: Option<f64>,
    /// What the rules say.
    pub rule_score: Option<f64>,
    /// Which of their cases it is.
    pub rule_case: Option<String>,
    /// Why it said nothing.
    pub error: Option<String>,
}

/// All verdicts, or those of a run, the oldest first.
///
/// # Errors
/// The database's.
pub async fn said(conn: &mut SqliteConnection, run: Option<&str>) -> Result<Vec<SaidRow>, StoreError> {
    Ok(sqlx::query_as!(
        SaidRow,
        r#"SELECT task, model, score, rule_score, rule_case, error FROM judge_verdicts
           WHERE ?1 IS NULL OR run = ?1 ORDER BY id"#,
        run
    )
    .fetch_all(conn)
    .await?)
}

/// What verdicts came to, by run and day; the run is empty where nobody flew for one.
///
/// # Errors
/// The database's.
pub async fn spent(conn: &mut SqliteConnection) -> Result<Vec<SpentRow>, StoreError> {
    Ok(sqlx::query_as!(
        SpentRow,
        r#"SELECT coalesce(run, '') AS "run!: String", at / 86400000 AS "day!: i64",
                  sum(tokens_in + tokens_out) AS "tokens!: i64", sum(cost) AS "cost!: f64"
           FROM judge_verdicts GROUP BY run, at / 86400000 ORDER BY run"#
    )
    .fetch_all(conn)
    .await?)
}
