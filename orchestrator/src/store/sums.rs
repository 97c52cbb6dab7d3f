//! Plain sums over all episodes, per run, task and level.

use sqlx::{SqliteConnection, query};

use super::StoreError;

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

/// Adds to the sums of a task and level.
///
/// # Errors
/// The database's.
pub async fn add(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    level: Option<i64>,
    sums: &Sums,
) -> Result<(), StoreError> {
    let level = level.unwrap_or(-1);
    query!(
        "INSERT INTO task_sums (run, task, level, episodes, successes, failed, expired, score, skilled, skill)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)
         ON CONFLICT (run, task, level) DO UPDATE SET
             episodes = episodes + excluded.episodes, successes = successes + excluded.successes,
             failed = failed + excluded.failed, expired = expired + excluded.expired,
             score = score + excluded.score, skilled = skilled + excluded.skilled, skill = skill + excluded.skill",
        run,
        task,
        level,
        sums.episodes,
        sums.successes,
        sums.failed,
        sums.expired,
        sums.score,
        sums.skilled,
        sums.skill
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// All sums of a run, by task.
///
/// # Errors
/// The database's.
pub async fn of_run(conn: &mut SqliteConnection, run: &str) -> Result<Vec<(String, Sums)>, StoreError> {
    let rows = query!(
        "SELECT task, episodes, successes, failed, expired, score, skilled, skill FROM task_sums
         WHERE run = ? ORDER BY task, level",
        run
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
