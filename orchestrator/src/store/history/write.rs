//! Adding to history.

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::super::{ROWS, StoreError};
use super::read::tasks;
use super::{HOUR, MINUTE, MINUTES_KEPT, Part};
use crate::clock::Millis;

/// Adds what came of a run's tasks at a moment: to its minute and to its hour.
///
/// # Errors
/// The database's.
pub async fn add(
    conn: &mut SqliteConnection,
    run: &str,
    now: Millis,
    parts: &[(String, Part)],
) -> Result<(), StoreError> {
    let buckets: Vec<_> = parts
        .iter()
        .flat_map(|(task, part)| {
            [MINUTE, HOUR].map(|width| (task.as_str(), width, now.div_euclid(width) * width, part))
        })
        .collect();
    for rows in buckets.chunks(ROWS) {
        add_parts(conn, run, rows).await?;
    }
    let params: Vec<_> = buckets
        .iter()
        .flat_map(|(task, width, start, part)| {
            part.params.iter().map(move |(name, spread)| (*task, *width, *start, name, spread))
        })
        .collect();
    for rows in params.chunks(ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT INTO history_params (run, task, width, start, param, n, total, low, high) ",
        );
        statement.push_values(rows, |mut values, (task, width, start, name, spread)| {
            values.push_bind(run).push_bind(*task).push_bind(*width).push_bind(*start).push_bind(*name);
            values.push_bind(spread.n).push_bind(spread.total).push_bind(spread.low).push_bind(spread.high);
        });
        statement.push(
            " ON CONFLICT (run, task, width, start, param) DO UPDATE SET n = n + excluded.n, total = total + excluded.total,
                  low = min(low, excluded.low), high = max(high, excluded.high)",
        );
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

async fn add_parts(
    conn: &mut SqliteConnection,
    run: &str,
    rows: &[(&str, Millis, Millis, &Part)],
) -> Result<(), StoreError> {
    let mut statement = QueryBuilder::new(
        "INSERT INTO history (run, task, width, start, episodes, successes, score, skilled, skill, failed, expired, contested,
                              solved, panels, panel, groups, flat, claimed, low, high, level, mean, q10, q90) ",
    );
    statement.push_values(rows, |mut values, (task, width, start, part)| {
        let standing = part.standing;
        values.push_bind(run).push_bind(*task).push_bind(*width).push_bind(*start);
        values.push_bind(part.episodes).push_bind(part.successes).push_bind(part.score);
        values.push_bind(part.skilled).push_bind(part.skill).push_bind(part.failed).push_bind(part.expired);
        values.push_bind(part.contested).push_bind(part.solved).push_bind(part.panels).push_bind(part.panel);
        values.push_bind(part.groups).push_bind(part.flat).push_bind(part.claimed);
        values.push_bind(part.low).push_bind(part.high);
        values.push_bind(standing.and_then(|at| at.level)).push_bind(standing.map(|at| at.mean));
        values.push_bind(standing.map(|at| at.q10)).push_bind(standing.map(|at| at.q90));
    });
    statement.push(
        " ON CONFLICT (run, task, width, start) DO UPDATE SET
              episodes = episodes + excluded.episodes, successes = successes + excluded.successes,
              score = score + excluded.score, skilled = skilled + excluded.skilled, skill = skill + excluded.skill,
              failed = failed + excluded.failed, expired = expired + excluded.expired,
              contested = contested + excluded.contested, solved = solved + excluded.solved,
              panels = panels + excluded.panels, panel = panel + excluded.panel,
              groups = groups + excluded.groups, flat = flat + excluded.flat,
              claimed = claimed + excluded.claimed,
              low = coalesce(min(low, excluded.low), low, excluded.low),
              high = coalesce(max(high, excluded.high), high, excluded.high),
              level = iif(excluded.mean IS NULL, level, excluded.level), mean = coalesce(excluded.mean, mean),
              q10 = coalesce(excluded.q10, q10), q90 = coalesce(excluded.q90, q90)",
    );
    statement.build().execute(conn).await?;
    Ok(())
}

/// Forgets a run's minutes of more than a week ago: what is theirs is in the hours, too. So many rows at most; whether there may be more.
///
/// # Errors
/// The database's.
pub async fn forget_minutes(
    conn: &mut SqliteConnection,
    run: &str,
    now: Millis,
    limit: i64,
) -> Result<bool, StoreError> {
    let before = now - MINUTES_KEPT;
    let tasks = tasks(&mut *conn, run).await?;
    let params = query!(
        "DELETE FROM history_params WHERE (run, task, width, start, param) IN (
             SELECT run, task, width, start, param FROM history_params
             WHERE run = ?1 AND task IN (SELECT value FROM json_each(?2)) AND width = 60000 AND start < ?3 LIMIT ?4)",
        run,
        tasks,
        before,
        limit
    )
    .execute(&mut *conn)
    .await?;
    let buckets = query!(
        "DELETE FROM history WHERE (run, task, width, start) IN (
             SELECT run, task, width, start FROM history
             WHERE run = ?1 AND task IN (SELECT value FROM json_each(?2)) AND width = 60000 AND start < ?3 LIMIT ?4)",
        run,
        tasks,
        before,
        limit
    )
    .execute(conn)
    .await?;
    Ok(params.rows_affected().max(buckets.rows_affected()) >= limit.unsigned_abs())
}
