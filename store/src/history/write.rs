//! Adds results to the history of a run, and deletes old buckets.

use std::collections::BTreeMap;

use sqlx::sqlite::SqliteQueryResult;
use sqlx::{QueryBuilder, SqliteConnection, query};

use super::super::{MAX_ROWS, StoreError};
use super::curves::add_to_curves;
use super::read::tasks;
use super::rungs::{RungRow, add_rungs};
use super::{HOUR, HistoryBucket, MINUTE, MINUTES_KEPT, ParamRange};
use crate::Millis;

/// A row of the `task_history` table to be added to.
struct BucketRow<'a> {
    task: &'a str,
    width: Millis,
    start: Millis,
    bucket: &'a HistoryBucket,
}

/// A row of the `task_history_params` table to be added to.
struct ParamRow<'a> {
    task: &'a str,
    width: Millis,
    start: Millis,
    name: &'a str,
    range: &'a ParamRange,
}

/// Adds the results of a run's tasks at the moment `now`, to its minute, to its hour and to the learning curves.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails, and [`StoreError::Corrupt`] if a stored point of a curve is damaged.
pub async fn add(
    conn: &mut SqliteConnection,
    run: &str,
    now: Millis,
    parts: &BTreeMap<String, HistoryBucket>,
) -> Result<(), StoreError> {
    let rows = parts.iter().flat_map(|(task, bucket)| {
        [MINUTE, HOUR].map(|width| BucketRow { task, width, start: now.div_euclid(width) * width, bucket })
    });
    let rows: Vec<BucketRow<'_>> = rows.collect();
    for rows in rows.chunks(MAX_ROWS) {
        add_buckets(conn, run, rows).await?;
    }
    let params = rows.iter().flat_map(|row| {
        let BucketRow { task, width, start, bucket } = *row;
        bucket.params.iter().map(move |(name, range)| ParamRow { task, width, start, name, range })
    });
    let params: Vec<ParamRow<'_>> = params.collect();
    for rows in params.chunks(MAX_ROWS) {
        add_params(conn, run, rows).await?;
    }
    let rungs = rows.iter().flat_map(|row| {
        let BucketRow { task, width, start, bucket } = *row;
        bucket.rungs.iter().map(move |(key, results)| RungRow {
            task,
            width,
            start,
            key: *key,
            results: *results,
        })
    });
    let rungs: Vec<RungRow<'_>> = rungs.collect();
    for rows in rungs.chunks(MAX_ROWS) {
        add_rungs(conn, run, rows).await?;
    }
    add_to_curves(conn, run, now, parts).await
}

async fn add_buckets(
    conn: &mut SqliteConnection,
    run: &str,
    rows: &[BucketRow<'_>],
) -> Result<(), StoreError> {
    let mut statement = QueryBuilder::new(
        "INSERT INTO task_history (run, task, width, start, episodes, successes, score_sum, episodes_with_skill, skill_sum, failed,
                                   expired, contested_groups, success_rate_sum, panel_groups, panel_success_rate_sum, groups,
                                   zero_variance_groups, claimed_episodes, timed_episodes, time_s_sum, lowest_level,
                                   highest_level, level, mean, q10, q90) ",
    );
    statement.push_values(rows, |mut values, BucketRow { task, width, start, bucket }| {
        let mastery = bucket.mastery;
        values.push_bind(run).push_bind(*task).push_bind(*width).push_bind(*start);
        values.push_bind(bucket.episodes).push_bind(bucket.successes).push_bind(bucket.score_sum);
        values.push_bind(bucket.episodes_with_skill).push_bind(bucket.skill_sum).push_bind(bucket.failed);
        values
            .push_bind(bucket.expired)
            .push_bind(bucket.contested_groups)
            .push_bind(bucket.success_rate_sum);
        values
            .push_bind(bucket.panel_groups)
            .push_bind(bucket.panel_success_rate_sum)
            .push_bind(bucket.groups);
        values
            .push_bind(bucket.zero_variance_groups)
            .push_bind(bucket.claimed_episodes)
            .push_bind(bucket.durations.episodes)
            .push_bind(bucket.durations.seconds)
            .push_bind(bucket.lowest_level)
            .push_bind(bucket.highest_level);
        values.push_bind(mastery.and_then(|at| at.level)).push_bind(mastery.map(|at| at.mean));
        values.push_bind(mastery.map(|at| at.q10)).push_bind(mastery.map(|at| at.q90));
    });
    statement.push(
        " ON CONFLICT (run, task, width, start) DO UPDATE SET
              episodes = episodes + excluded.episodes, successes = successes + excluded.successes,
              score_sum = score_sum + excluded.score_sum,
              episodes_with_skill = episodes_with_skill + excluded.episodes_with_skill,
              skill_sum = skill_sum + excluded.skill_sum, failed = failed + excluded.failed,
              expired = expired + excluded.expired, contested_groups = contested_groups + excluded.contested_groups,
              success_rate_sum = success_rate_sum + excluded.success_rate_sum,
              panel_groups = panel_groups + excluded.panel_groups,
              panel_success_rate_sum = panel_success_rate_sum + excluded.panel_success_rate_sum,
              groups = groups + excluded.groups,
              zero_variance_groups = zero_variance_groups + excluded.zero_variance_groups,
              claimed_episodes = claimed_episodes + excluded.claimed_episodes,
              timed_episodes = timed_episodes + excluded.timed_episodes,
              time_s_sum = time_s_sum + excluded.time_s_sum,
              lowest_level = coalesce(min(lowest_level, excluded.lowest_level), lowest_level, excluded.lowest_level),
              highest_level = coalesce(max(highest_level, excluded.highest_level), highest_level, excluded.highest_level),
              level = iif(excluded.mean IS NULL, level, excluded.level), mean = coalesce(excluded.mean, mean),
              q10 = coalesce(excluded.q10, q10), q90 = coalesce(excluded.q90, q90)",
    );
    statement.build().execute(conn).await?;
    Ok(())
}

async fn add_params(conn: &mut SqliteConnection, run: &str, rows: &[ParamRow<'_>]) -> Result<(), StoreError> {
    let mut statement = QueryBuilder::new(
        "INSERT INTO task_history_params (run, task, width, start, param, n, total, low, high) ",
    );
    statement.push_values(rows, |mut values, ParamRow { task, width, start, name, range }| {
        values.push_bind(run).push_bind(*task).push_bind(*width).push_bind(*start).push_bind(*name);
        values.push_bind(range.n).push_bind(range.total).push_bind(range.low).push_bind(range.high);
    });
    statement.push(
        " ON CONFLICT (run, task, width, start, param) DO UPDATE SET n = n + excluded.n, total = total + excluded.total,
              low = min(low, excluded.low), high = max(high, excluded.high)",
    );
    statement.build().execute(conn).await?;
    Ok(())
}

/// Deletes up to `limit` buckets of a minute that are older than a week; their results are in the hours, too. Returns true if
/// there may be more.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn delete_old_minutes(
    conn: &mut SqliteConnection,
    run: &str,
    now: Millis,
    limit: i64,
) -> Result<bool, StoreError> {
    let before = now - MINUTES_KEPT;
    let tasks = tasks(&mut *conn, run).await?;
    let params = query!(
        "DELETE FROM task_history_params WHERE (run, task, width, start, param) IN (
             SELECT run, task, width, start, param FROM task_history_params
             WHERE run = ?1 AND task IN (SELECT value FROM json_each(?2)) AND width = 60000 AND start < ?3 LIMIT ?4)",
        run,
        tasks,
        before,
        limit
    )
    .execute(&mut *conn)
    .await?;
    let rungs = query!(
        "DELETE FROM task_history_rungs WHERE (run, task, width, start, start_rung, level) IN (
             SELECT run, task, width, start, start_rung, level FROM task_history_rungs
             WHERE run = ?1 AND task IN (SELECT value FROM json_each(?2)) AND width = 60000 AND start < ?3 LIMIT ?4)",
        run,
        tasks,
        before,
        limit
    )
    .execute(&mut *conn)
    .await?;
    let buckets = query!(
        "DELETE FROM task_history WHERE (run, task, width, start) IN (
             SELECT run, task, width, start FROM task_history
             WHERE run = ?1 AND task IN (SELECT value FROM json_each(?2)) AND width = 60000 AND start < ?3 LIMIT ?4)",
        run,
        tasks,
        before,
        limit
    )
    .execute(conn)
    .await?;
    let most = [params, rungs, buckets].iter().map(SqliteQueryResult::rows_affected).max();
    Ok(most.is_some_and(|most| most >= limit.unsigned_abs()))
}
