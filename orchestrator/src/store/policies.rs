//! Policies that workers fly for runs, what that came to, and the leases they hold.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use super::asks::SpentRow;
use crate::clock::Millis;

/// The policy of a run as stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PolicyRow {
    /// The run.
    pub run: String,
    /// `off`, `chat`, or a built-in one by name.
    pub policy: String,
    /// Its version.
    pub version: i64,
    /// JSON.
    pub settings: String,
    /// Groups pushed to the feed so far.
    pub groups: i64,
    /// Episodes in them.
    pub episodes: i64,
    /// Episodes that the infrastructure lost.
    pub failed: i64,
    /// The last thing that went wrong.
    pub trouble: Option<String>,
    /// When.
    pub trouble_at: Option<Millis>,
    /// When it was set.
    pub changed_at: Millis,
}

/// The policy of a run; none where none was ever set.
///
/// # Errors
/// The database's.
pub async fn get(conn: &mut SqliteConnection, run: &str) -> Result<Option<PolicyRow>, StoreError> {
    Ok(sqlx::query_as!(
        PolicyRow,
        "SELECT run, policy, version, settings, groups, episodes, failed, trouble, trouble_at, changed_at
         FROM run_policies WHERE run = ?",
        run
    )
    .fetch_optional(conn)
    .await?)
}

/// Policies that are to be flown now: those that are not off, of runs that are not paused.
///
/// # Errors
/// The database's.
pub async fn on(conn: &mut SqliteConnection) -> Result<Vec<PolicyRow>, StoreError> {
    Ok(sqlx::query_as!(
        PolicyRow,
        "SELECT p.run, p.policy, p.version, p.settings, p.groups, p.episodes, p.failed, p.trouble, p.trouble_at,
                p.changed_at
         FROM run_policies AS p JOIN runs AS r ON r.id = p.run
         WHERE p.policy <> 'off' AND r.status = 'active' ORDER BY p.run"
    )
    .fetch_all(conn)
    .await?)
}

/// Sets the policy of a run; what it came to so far stays.
///
/// # Errors
/// The database's.
pub async fn put(
    conn: &mut SqliteConnection,
    run: &str,
    (policy, version): (&str, i64),
    settings: &str,
    now: Millis,
) -> Result<(), StoreError> {
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

/// Counts a group that was flown: whether it was pushed, its episodes, and those that were lost.
///
/// # Errors
/// The database's.
pub async fn count(
    conn: &mut SqliteConnection,
    run: &str,
    (groups, episodes, failed): (i64, i64, i64),
) -> Result<(), StoreError> {
    query!(
        "UPDATE run_policies SET groups = groups + ?, episodes = episodes + ?, failed = failed + ? WHERE run = ?",
        groups,
        episodes,
        failed,
        run
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Remembers what went wrong.
///
/// # Errors
/// The database's.
pub async fn trouble(
    conn: &mut SqliteConnection,
    run: &str,
    words: &str,
    now: Millis,
) -> Result<(), StoreError> {
    query!("UPDATE run_policies SET trouble = ?, trouble_at = ? WHERE run = ?", words, now, run)
        .execute(conn)
        .await?;
    Ok(())
}

/// Adds what a run's tokens came to on a day.
///
/// # Errors
/// The database's.
pub async fn spend(
    conn: &mut SqliteConnection,
    run: &str,
    day: i64,
    (tokens_in, tokens_out): (i64, i64),
    cost: f64,
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO rollout_spent (run, day, tokens_in, tokens_out, cost) VALUES (?, ?, ?, ?, ?)
         ON CONFLICT (run, day) DO UPDATE SET tokens_in = tokens_in + excluded.tokens_in,
                                              tokens_out = tokens_out + excluded.tokens_out,
                                              cost = cost + excluded.cost",
        run,
        day,
        tokens_in,
        tokens_out,
        cost
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Tokens of a run in all: in, out.
///
/// # Errors
/// The database's.
pub async fn tokens(conn: &mut SqliteConnection, run: &str) -> Result<(i64, i64), StoreError> {
    let row = query!(
        r#"SELECT coalesce(sum(tokens_in), 0) AS "read!: i64", coalesce(sum(tokens_out), 0) AS "written!: i64"
           FROM rollout_spent WHERE run = ?"#,
        run
    )
    .fetch_one(conn)
    .await?;
    Ok((row.read, row.written))
}

/// What was spent, by run and day.
///
/// # Errors
/// The database's.
pub async fn spent(conn: &mut SqliteConnection) -> Result<Vec<SpentRow>, StoreError> {
    Ok(sqlx::query_as!(
        SpentRow,
        r#"SELECT run, day, tokens_in + tokens_out AS "tokens!: i64", cost FROM rollout_spent ORDER BY run, day"#
    )
    .fetch_all(conn)
    .await?)
}

/// Remembers that a worker flies this lease.
///
/// # Errors
/// The database's.
pub async fn hold(conn: &mut SqliteConnection, lease: i64) -> Result<(), StoreError> {
    query!("INSERT INTO rollout_leases (lease) VALUES (?)", lease).execute(conn).await?;
    Ok(())
}

/// Forgets it: the lease is done, or given back.
///
/// # Errors
/// The database's.
pub async fn let_go(conn: &mut SqliteConnection, lease: i64) -> Result<(), StoreError> {
    query!("DELETE FROM rollout_leases WHERE lease = ?", lease).execute(conn).await?;
    Ok(())
}

/// Leases that workers fly, or flew when the server went away.
///
/// # Errors
/// The database's.
pub async fn held(conn: &mut SqliteConnection) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT lease FROM rollout_leases ORDER BY lease").fetch_all(conn).await?)
}
