//! Verdicts of a language model on single steps, beside those of the world's rules. Table `step_verdicts`.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::Millis;

/// Row of the `step_verdicts` table.
#[derive(Debug, Clone, PartialEq)]
pub struct StepVerdictRow {
    /// Id of the run; none if the session does not belong to one.
    pub run: Option<String>,
    /// The client's name of the episode.
    pub episode: String,
    /// Id of the scenario.
    pub scenario: Vec<u8>,
    /// Task of the episode.
    pub task: String,
    /// Number of the step, from 1.
    pub step: i64,
    /// Name of the model.
    pub model: String,
    /// Version of the model's prompt.
    pub prompt_version: String,
    /// The model's score, −1 to 1; none if the model gave none.
    pub score: Option<f64>,
    /// Explanation that the model gave.
    pub reasoning: Option<String>,
    /// Why the model gave no score.
    pub error: Option<String>,
    /// Score by the world's rules, −1 to 1; none if the step does not count by itself.
    pub rule_score: Option<f64>,
    /// Case of the rules that applied.
    pub rule_case: Option<String>,
    /// True if the same question was asked before.
    pub is_cached: bool,
    /// Number of prompt tokens.
    pub tokens_in: i64,
    /// Number of completion tokens.
    pub tokens_out: i64,
    /// Cost in the currency of the configured prices.
    pub cost: f64,
    /// Duration of it, milliseconds.
    pub latency_ms: i64,
}

/// Stores a verdict.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn insert(conn: &mut SqliteConnection, row: &StepVerdictRow, at: Millis) -> Result<(), StoreError> {
    query!(
        "INSERT INTO step_verdicts (at, run, episode, scenario, task, step, model, prompt_version, score, reasoning,
                                    error, rule_score, rule_case, is_cached, tokens_in, tokens_out, cost, latency_ms)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        at,
        row.run,
        row.episode,
        row.scenario,
        row.task,
        row.step,
        row.model,
        row.prompt_version,
        row.score,
        row.reasoning,
        row.error,
        row.rule_score,
        row.rule_case,
        row.is_cached,
        row.tokens_in,
        row.tokens_out,
        row.cost,
        row.latency_ms
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Scores of a step by the model and by the rules.
#[derive(Debug, Clone, PartialEq)]
pub struct StepScores {
    /// Task of the episode.
    pub task: String,
    /// Name of the model.
    pub model: String,
    /// The model's score; none if the model gave none.
    pub score: Option<f64>,
    /// Score by the world's rules.
    pub rule_score: Option<f64>,
    /// Case of the rules that applied.
    pub rule_case: Option<String>,
    /// Why the model gave no score.
    pub error: Option<String>,
}

/// Reads the scores of all judged steps, or of those of a run, oldest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn scores(conn: &mut SqliteConnection, run: Option<&str>) -> Result<Vec<StepScores>, StoreError> {
    Ok(sqlx::query_as!(
        StepScores,
        r#"SELECT task, model, score, rule_score, rule_case, error FROM step_verdicts
           WHERE ?1 IS NULL OR run = ?1 ORDER BY id"#,
        run
    )
    .fetch_all(conn)
    .await?)
}
