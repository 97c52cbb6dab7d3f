//! Counters of all episodes, by run, task and level; those of designed groups are apart. Table `task_counters`.

use std::collections::BTreeMap;

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::groups::GroupRow;
use super::{MAX_ROWS, StoreError};

/// Counters of a task's episodes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TaskCounters {
    /// Number of finished episodes.
    pub episodes: i64,
    /// Finished episodes that succeeded.
    pub successes: i64,
    /// Number of failed episodes.
    pub failed: i64,
    /// Episodes whose lease ended before they were reported.
    pub expired: i64,
    /// Sum of the scores.
    pub score_sum: f64,
    /// Finished episodes that have a skill.
    pub episodes_with_skill: i64,
    /// Sum of the skills.
    pub skill_sum: f64,
}

impl TaskCounters {
    /// Adds the counters of `other`.
    pub fn add(&mut self, other: &Self) {
        self.episodes += other.episodes;
        self.successes += other.successes;
        self.failed += other.failed;
        self.expired += other.expired;
        self.score_sum += other.score_sum;
        self.episodes_with_skill += other.episodes_with_skill;
        self.skill_sum += other.skill_sum;
    }
}

/// Key of task counters.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct TaskCountersKey {
    /// Id of the task.
    pub task: String,
    /// The level; none for strategies without levels.
    pub level: Option<i64>,
    /// True for designed groups.
    pub is_designed: bool,
}

impl TaskCountersKey {
    /// Key of the counters that a group's episodes belong to.
    #[must_use]
    pub fn of(group: &GroupRow) -> Self {
        Self { task: group.task.clone(), level: group.level, is_designed: group.layout.is_some() }
    }
}

/// Adds to the counters of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn add(
    conn: &mut SqliteConnection,
    run: &str,
    all: &BTreeMap<TaskCountersKey, TaskCounters>,
) -> Result<(), StoreError> {
    let all: Vec<_> = all.iter().collect();
    for rows in all.chunks(MAX_ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT INTO task_counters (run, task, level, is_designed, episodes, successes, failed, expired, score_sum,
                                        episodes_with_skill, skill_sum) ",
        );
        statement.push_values(rows, |mut values, (key, counters)| {
            values.push_bind(run).push_bind(&key.task).push_bind(key.level.unwrap_or(-1));
            values.push_bind(key.is_designed).push_bind(counters.episodes).push_bind(counters.successes);
            values.push_bind(counters.failed).push_bind(counters.expired).push_bind(counters.score_sum);
            values.push_bind(counters.episodes_with_skill).push_bind(counters.skill_sum);
        });
        statement.push(
            " ON CONFLICT (run, task, level, is_designed) DO UPDATE SET
             episodes = episodes + excluded.episodes, successes = successes + excluded.successes,
             failed = failed + excluded.failed, expired = expired + excluded.expired,
             score_sum = score_sum + excluded.score_sum,
             episodes_with_skill = episodes_with_skill + excluded.episodes_with_skill,
             skill_sum = skill_sum + excluded.skill_sum",
        );
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Reads the counters of a run by task: those of designed groups, or of all others.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_run(
    conn: &mut SqliteConnection,
    run: &str,
    are_designed: bool,
) -> Result<BTreeMap<String, TaskCounters>, StoreError> {
    let rows = query!(
        "SELECT task, episodes, successes, failed, expired, score_sum, episodes_with_skill, skill_sum FROM task_counters
         WHERE run = ? AND is_designed = ? ORDER BY task, level",
        run,
        are_designed
    )
    .fetch_all(conn)
    .await?;
    let mut by_task = BTreeMap::<String, TaskCounters>::new();
    for r in rows {
        by_task.entry(r.task).or_default().add(&TaskCounters {
            episodes: r.episodes,
            successes: r.successes,
            failed: r.failed,
            expired: r.expired,
            score_sum: r.score_sum,
            episodes_with_skill: r.episodes_with_skill,
            skill_sum: r.skill_sum,
        });
    }
    Ok(by_task)
}
