//! Results by start rung and level over time. Table `task_history_rungs`.

use serde::{Deserialize, Serialize};
use sqlx::{QueryBuilder, SqliteConnection, query};

use super::super::StoreError;
use super::HistoryWindow;
use super::read::tasks;
use crate::Millis;

/// Number that stands for no start rung or no level in a key.
const NONE: i64 = -1;

/// Start rung and level of a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct RungKey {
    /// Start rung; none in tasks without them, and under strategies that leave starts as they are.
    pub start_rung: Option<i64>,
    /// Level; none if the start is easier than that of any level, or the params belong to no level.
    pub level: Option<i64>,
}

/// Results of the groups at a rung.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RungResults {
    /// Number of groups with enough finished episodes.
    pub groups: i64,
    /// Number of finished episodes that count.
    pub episodes: i64,
    /// Number of successes among them.
    pub successes: i64,
}

impl RungResults {
    /// Adds the results of other groups.
    pub const fn join(&mut self, other: Self) {
        self.groups += other.groups;
        self.episodes += other.episodes;
        self.successes += other.successes;
    }
}

/// Results by rung as a JSON list, since keys of JSON are texts.
pub(super) mod as_list {
    use std::collections::BTreeMap;

    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::{RungKey, RungResults};

    pub(in super::super) fn serialize<S: Serializer>(
        rungs: &BTreeMap<RungKey, RungResults>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        rungs.iter().collect::<Vec<_>>().serialize(serializer)
    }

    pub(in super::super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<BTreeMap<RungKey, RungResults>, D::Error> {
        Ok(Vec::<(RungKey, RungResults)>::deserialize(deserializer)?.into_iter().collect())
    }
}

/// Results at a rung in a point of a task's history.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RungPoint {
    /// Id of the task.
    pub task: String,
    /// Begin of the point, milliseconds since 1970-01-01 UTC.
    pub start: Millis,
    /// Start rung and level.
    pub key: RungKey,
    /// Results of the groups there.
    pub results: RungResults,
}

/// Reads the results of a run by rung in a window, by task and time.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn rung_points(
    conn: &mut SqliteConnection,
    run: &str,
    window: HistoryWindow,
) -> Result<Vec<RungPoint>, StoreError> {
    let HistoryWindow { from, to, width, stored } = window;
    let tasks = tasks(&mut *conn, run).await?;
    let rows = query!(
        r#"SELECT task AS "task!", start / ?5 * ?5 AS "bucket!: i64", start_rung AS "start_rung!", level AS "level!",
                  sum(groups) AS "groups!: i64", sum(episodes) AS "episodes!: i64", sum(successes) AS "successes!: i64"
           FROM task_history_rungs WHERE run = ?1 AND task IN (SELECT value FROM json_each(?6))
                AND width = ?2 AND start >= ?3 AND start < ?4
           GROUP BY 1, 2, 3, 4 ORDER BY 1, 2, 3, 4"#,
        run,
        stored,
        from,
        to,
        width,
        tasks
    )
    .fetch_all(conn)
    .await?;
    let known = |number: i64| Some(number).filter(|number| *number != NONE);
    let points = rows.into_iter().map(|r| RungPoint {
        task: r.task,
        start: r.bucket,
        key: RungKey { start_rung: known(r.start_rung), level: known(r.level) },
        results: RungResults { groups: r.groups, episodes: r.episodes, successes: r.successes },
    });
    Ok(points.collect())
}

/// Row of the `task_history_rungs` table to be added to.
#[derive(Clone, Copy)]
pub(super) struct RungRow<'a> {
    pub(super) task: &'a str,
    pub(super) width: Millis,
    pub(super) start: Millis,
    pub(super) key: RungKey,
    pub(super) results: RungResults,
}

/// Adds results to the stored ones.
pub(super) async fn add_rungs(
    conn: &mut SqliteConnection,
    run: &str,
    rows: &[RungRow<'_>],
) -> Result<(), StoreError> {
    let mut statement = QueryBuilder::new(
        "INSERT INTO task_history_rungs (run, task, width, start, start_rung, level, groups, episodes, successes) ",
    );
    statement.push_values(rows, |mut values, RungRow { task, width, start, key, results }| {
        values.push_bind(run).push_bind(*task).push_bind(*width).push_bind(*start);
        values.push_bind(key.start_rung.unwrap_or(NONE)).push_bind(key.level.unwrap_or(NONE));
        values.push_bind(results.groups).push_bind(results.episodes).push_bind(results.successes);
    });
    statement.push(
        " ON CONFLICT (run, task, width, start, start_rung, level) DO UPDATE SET groups = groups + excluded.groups,
              episodes = episodes + excluded.episodes, successes = successes + excluded.successes",
    );
    statement.build().execute(conn).await?;
    Ok(())
}
