//! Plain sums over all episodes, per run, task and level; those of designed groups apart.

use std::collections::BTreeMap;

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::groups::GroupRow;
use super::{ROWS, StoreError};

/// Sums as stored. Level −1 is for strategies without levels.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sums {
    /// Episodes that finished.
    pub episodes: i64,
    /// Of these, successes.
    pub successes: i64,
    /// Episodes that failed.
    pub failed: i64,
    /// Episodes whose lease ended before they came back.
    pub expired: i64,
    /// Sum of scores.
    pub score: f64,
    /// Episodes that have a skill.
    pub skilled: i64,
    /// Sum of skills.
    pub skill: f64,
}

impl Sums {
    /// Adds others.
    pub fn add(&mut self, other: &Self) {
        self.episodes += other.episodes;
        self.successes += other.successes;
        self.failed += other.failed;
        self.expired += other.expired;
        self.score += other.score;
        self.skilled += other.skilled;
        self.skill += other.skill;
    }
}

/// Which sums: of a task, at a level, of designed groups or of all others.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Key {
    /// The task.
    pub task: String,
    /// The level; none where the strategy has none.
    pub level: Option<i64>,
    /// Whether the groups were designed.
    pub designed: bool,
}

impl Key {
    /// Where a group's episodes count.
    #[must_use]
    pub fn of(group: &GroupRow) -> Self {
        Self { task: group.task.clone(), level: group.level, designed: group.layout.is_some() }
    }
}

/// Adds to sums, many at a time.
///
/// # Errors
/// The database's.
pub async fn add(
    conn: &mut SqliteConnection,
    run: &str,
    all: &BTreeMap<Key, Sums>,
) -> Result<(), StoreError> {
    let all: Vec<_> = all.iter().collect();
    for rows in all.chunks(ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT INTO task_sums (run, task, level, designed, episodes, successes, failed, expired, score, skilled,
                                    skill) ",
        );
        statement.push_values(rows, |mut values, (key, sums)| {
            values
                .push_bind(run)
                .push_bind(&key.task)
                .push_bind(key.level.unwrap_or(-1))
                .push_bind(key.designed);
            values.push_bind(sums.episodes).push_bind(sums.successes).push_bind(sums.failed);
            values
                .push_bind(sums.expired)
                .push_bind(sums.score)
                .push_bind(sums.skilled)
                .push_bind(sums.skill);
        });
        statement.push(
            " ON CONFLICT (run, task, level, designed) DO UPDATE SET
             episodes = episodes + excluded.episodes, successes = successes + excluded.successes,
             failed = failed + excluded.failed, expired = expired + excluded.expired,
             score = score + excluded.score, skilled = skilled + excluded.skilled, skill = skill + excluded.skill",
        );
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// All sums of a run, by task: those of designed groups, or of all others.
///
/// # Errors
/// The database's.
pub async fn of_run(
    conn: &mut SqliteConnection,
    run: &str,
    designed: bool,
) -> Result<Vec<(String, Sums)>, StoreError> {
    let rows = query!(
        "SELECT task, episodes, successes, failed, expired, score, skilled, skill FROM task_sums
         WHERE run = ? AND designed = ? ORDER BY task, level",
        run,
        designed
    )
    .fetch_all(conn)
    .await?;
    let mut by_task: Vec<(String, Sums)> = Vec::new();
    for r in rows {
        let sums = Sums {
            episodes: r.episodes,
            successes: r.successes,
            failed: r.failed,
            expired: r.expired,
            score: r.score,
            skilled: r.skilled,
            skill: r.skill,
        };
        match by_task.last_mut() {
            Some((task, all)) if *task == r.task => all.add(&sums),
            _ => by_task.push((r.task, sums)),
        }
    }
    Ok(by_task)
}
