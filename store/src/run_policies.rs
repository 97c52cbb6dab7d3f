//! Policies that the server's workers roll out for runs: settings, totals, and the leases that workers hold. Tables
//! `run_policies`, `rollout_spend` and `rollout_leases`.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::Millis;

/// Policy of a run that the server's workers roll out.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum RunPolicy {
    /// No policy: no rollouts.
    #[default]
    Off,
    /// The language model of the server's configuration.
    Chat,
    /// A built-in policy by its name, or a policy file.
    BuiltIn(String),
}

impl RunPolicy {
    /// The word that is stored and sent.
    #[must_use]
    pub fn as_str(&self) -> &str {
        match self {
            Self::Off => "off",
            Self::Chat => "chat",
            Self::BuiltIn(name) => name,
        }
    }
}

impl From<String> for RunPolicy {
    fn from(word: String) -> Self {
        match word.as_str() {
            "off" => Self::Off,
            "chat" => Self::Chat,
            _ => Self::BuiltIn(word),
        }
    }
}

impl std::fmt::Display for RunPolicy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Row of the `run_policies` table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunPolicyRow {
    /// Id of the run.
    pub run: String,
    /// Policy of the run.
    pub policy: RunPolicy,
    /// Version of the policy.
    pub version: i64,
    /// The settings as JSON.
    pub settings: String,
    /// Groups pushed to the feed so far.
    pub groups: i64,
    /// Episodes in these groups.
    pub episodes: i64,
    /// Episodes that the infrastructure lost.
    pub failed: i64,
    /// The latest problem, in a sentence.
    pub error: Option<String>,
    /// When the latest problem occurred.
    pub error_at: Option<Millis>,
    /// When the policy was set.
    pub changed_at: Millis,
}

/// Rollouts to add to the totals of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RolloutCounts {
    /// Groups pushed to the feed.
    pub groups: i64,
    /// Episodes in these groups.
    pub episodes: i64,
    /// Episodes that the infrastructure lost.
    pub failed: i64,
}

/// Tokens of a language model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TokenCounts {
    /// Number of prompt tokens.
    pub tokens_in: i64,
    /// Number of completion tokens.
    pub tokens_out: i64,
}

/// Reads the policy of a run; none if none was ever set.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get(conn: &mut SqliteConnection, run: &str) -> Result<Option<RunPolicyRow>, StoreError> {
    Ok(sqlx::query_as!(
        RunPolicyRow,
        "SELECT run, policy, version, settings, groups, episodes, failed, error, error_at, changed_at
         FROM run_policies WHERE run = ?",
        run
    )
    .fetch_optional(conn)
    .await?)
}

/// Reads the policies to roll out now: those that are not off, of active runs.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn active(conn: &mut SqliteConnection) -> Result<Vec<RunPolicyRow>, StoreError> {
    Ok(sqlx::query_as!(
        RunPolicyRow,
        "SELECT p.run, p.policy, p.version, p.settings, p.groups, p.episodes, p.failed, p.error, p.error_at, p.changed_at
         FROM run_policies AS p JOIN runs AS r ON r.id = p.run
         WHERE p.policy <> 'off' AND r.status = 'active' ORDER BY p.run"
    )
    .fetch_all(conn)
    .await?)
}

/// Sets the policy of a run. Its totals stay.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn put(
    conn: &mut SqliteConnection,
    run: &str,
    policy: &RunPolicy,
    version: i64,
    settings: &str,
    now: Millis,
) -> Result<(), StoreError> {
    let policy = policy.as_str();
    query!(
        "INSERT INTO run_policies (run, policy, version, settings, changed_at) VALUES (?, ?, ?, ?, ?)
         ON CONFLICT (run) DO UPDATE SET policy = excluded.policy, version = excluded.version,
                                         settings = excluded.settings, changed_at = excluded.changed_at",
        run,
        policy,
        version,
        settings,
        now
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Adds rollouts to the totals of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add_rollouts(
    conn: &mut SqliteConnection,
    run: &str,
    added: RolloutCounts,
) -> Result<(), StoreError> {
    query!(
        "UPDATE run_policies SET groups = groups + ?, episodes = episodes + ?, failed = failed + ? WHERE run = ?",
        added.groups,
        added.episodes,
        added.failed,
        run
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Sets the latest problem of a run's policy, in a sentence.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_error(
    conn: &mut SqliteConnection,
    run: &str,
    error: &str,
    now: Millis,
) -> Result<(), StoreError> {
    query!("UPDATE run_policies SET error = ?, error_at = ? WHERE run = ?", error, now, run)
        .execute(conn)
        .await?;
    Ok(())
}

/// Removes the error of a run's policy if it begins with a text.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn clear_error(conn: &mut SqliteConnection, run: &str, beginning: &str) -> Result<(), StoreError> {
    query!(
        "UPDATE run_policies SET error = NULL, error_at = NULL
         WHERE run = ?1 AND substr(error, 1, length(?2)) = ?2",
        run,
        beginning
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Adds tokens and cost to what a run spent on a day (days since 1970-01-01 UTC).
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add_spend(
    conn: &mut SqliteConnection,
    run: &str,
    day: i64,
    tokens: TokenCounts,
    cost: f64,
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO rollout_spend (run, day, tokens_in, tokens_out, cost) VALUES (?, ?, ?, ?, ?)
         ON CONFLICT (run, day) DO UPDATE SET tokens_in = tokens_in + excluded.tokens_in,
                                              tokens_out = tokens_out + excluded.tokens_out,
                                              cost = cost + excluded.cost",
        run,
        day,
        tokens.tokens_in,
        tokens.tokens_out,
        cost
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads all tokens that the rollouts of a run took.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn tokens(conn: &mut SqliteConnection, run: &str) -> Result<TokenCounts, StoreError> {
    Ok(sqlx::query_as!(
        TokenCounts,
        r#"SELECT coalesce(sum(tokens_in), 0) AS "tokens_in!: i64", coalesce(sum(tokens_out), 0) AS "tokens_out!: i64"
           FROM rollout_spend WHERE run = ?"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// Marks a lease as held by a worker of the server.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn hold_lease(conn: &mut SqliteConnection, lease: i64) -> Result<(), StoreError> {
    query!("INSERT INTO rollout_leases (lease) VALUES (?)", lease).execute(conn).await?;
    Ok(())
}

/// Removes the mark of a lease that is done or released.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn release_lease(conn: &mut SqliteConnection, lease: i64) -> Result<(), StoreError> {
    query!("DELETE FROM rollout_leases WHERE lease = ?", lease).execute(conn).await?;
    Ok(())
}

/// Reads the leases that workers hold, or held when the server stopped.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn held_leases(conn: &mut SqliteConnection) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT lease FROM rollout_leases ORDER BY lease").fetch_all(conn).await?)
}
