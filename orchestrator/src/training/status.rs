//! Looking at a run: where its tasks stand. Asked of the writer, which has it in memory; it changes nothing.

use sqlx::SqliteConnection;

use super::mind::Mind;
use super::{Change, RunSettings, TrainingError, Work};
use crate::ids::RunId;
use crate::store::closings::{self, GroupSums};
use crate::store::columns::{self, ClaimedSums};
use crate::store::pulse;
use crate::store::sums::{self, Sums};
use curriculum::{Explanation, Mastery, TaskStatus};

/// Asks where a run stands.
#[derive(Debug)]
pub struct Look {
    /// Which.
    pub run: RunId,
}

/// Where a run stands, all of one moment.
#[derive(Debug)]
pub struct Standing {
    /// Its settings.
    pub settings: RunSettings,
    /// Where each task stands.
    pub status: Vec<TaskStatus>,
    /// What was mastered, per task and level.
    pub mastery: Vec<Mastery>,
    /// The rules and what moved, in words.
    pub explanation: Explanation,
    /// Plain sums, per task; those of designed groups are not in them.
    pub sums: Vec<(String, Sums)>,
    /// Plain sums of designed groups, per task.
    pub designed: Vec<(String, Sums)>,
    /// Plain sums of what was claimed in columns, per task.
    pub claimed: Vec<(String, ClaimedSums)>,
    /// How groups of several episodes ended, per task and level.
    pub groups: Vec<GroupSums>,
    /// Events so far.
    pub next_seq: u64,
}

impl Change for Look {
    type Answer = Standing;

    async fn apply(self, work: &mut Work) -> Result<Standing, TrainingError> {
        let (mind, conn) = work.mind(self.run.as_str()).await?;
        Standing::of(mind, conn, self.run.as_str()).await
    }
}

impl Standing {
    /// Of a run as it is stored, for who has no writer.
    ///
    /// # Errors
    /// The database's, or a run that there is not.
    pub async fn stored(conn: &mut SqliteConnection, run: &str) -> Result<Self, TrainingError> {
        let mind = Mind::load(conn, run).await?;
        Self::of(&mind, conn, run).await
    }

    async fn of(mind: &Mind, conn: &mut SqliteConnection, run: &str) -> Result<Self, TrainingError> {
        Ok(Self {
            settings: mind.settings.clone(),
            status: mind.curriculum.status(),
            mastery: mind.curriculum.mastery(),
            explanation: mind.curriculum.explain(),
            sums: sums::of_run(conn, run, false).await?,
            designed: sums::of_run(conn, run, true).await?,
            claimed: columns::sums(conn, run).await?,
            groups: closings::of_run(conn, run).await?,
            next_seq: mind.curriculum.next_seq(),
        })
    }
}

/// Asks where a run's tasks stand now, and nothing else.
#[derive(Debug)]
pub struct Glance {
    /// Which run.
    pub run: RunId,
}

/// Where a task stands at a glance.
#[derive(Debug, Clone, PartialEq)]
pub struct Glanced {
    /// The task.
    pub task: String,
    /// Its level; none where there are none, and during placement.
    pub level: Option<u32>,
    /// What is known of success there; none before there is evidence.
    pub mastery: Option<Mastery>,
}

impl Change for Glance {
    type Answer = Vec<Glanced>;

    async fn apply(self, work: &mut Work) -> Result<Vec<Glanced>, TrainingError> {
        let (mind, _) = work.mind(self.run.as_str()).await?;
        let mut mastery = mind.curriculum.mastery();
        mastery.retain(|known| known.n > 0);
        let glance = |status: TaskStatus| {
            let here = mastery.iter().find(|known| known.task == status.task && known.level == status.level);
            let level = status.level.filter(|_| status.placed);
            Glanced { task: status.task, level, mastery: here.cloned() }
        };
        Ok(mind.curriculum.status().into_iter().map(glance).collect())
    }
}

/// Where a task of a run stands, in numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Gauge {
    /// The run.
    pub run: String,
    /// The task.
    pub task: String,
    /// Its level; none where there are none, and during placement.
    pub level: Option<u32>,
    /// Mean of the posterior over success there, once there is evidence.
    pub mastery: Option<f64>,
}

/// Asks where the runs stand that are in memory.
#[derive(Debug)]
pub struct Gauges;

/// Runs that are told of at most: each has series of its own wherever they are kept.
const RUNS: usize = 100;

impl Change for Gauges {
    type Answer = Vec<Gauge>;
    const BULK: bool = true;

    async fn apply(self, work: &mut Work) -> Result<Vec<Gauge>, TrainingError> {
        let mut gauges = Vec::new();
        for mind in work.minds().take(RUNS) {
            let mastery = mind.curriculum.mastery();
            for status in mind.curriculum.status() {
                let here = |m: &&Mastery| m.task == status.task && m.level == status.level;
                let mastery = mastery.iter().find(here).map(|m| m.mean);
                let level = status.level.filter(|_| status.placed);
                gauges.push(Gauge { run: mind.run.clone(), task: status.task, level, mastery });
            }
        }
        Ok(gauges)
    }
}

/// Writes that it was there: the answer says that the writer can write. Where a change could not be stored it writes as much as a
/// large one: a disk that is full has room for a row.
#[derive(Debug)]
pub struct Ping;

impl Change for Ping {
    type Answer = ();

    async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
        pulse::beat(&mut work.conn, work.now, work.troubled).await?;
        work.troubled = false; // and again, where this is not committed
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Clock;
    use crate::store::{self, Trouble};
    use crate::training::{Wakes, Writer};

    /// Writes so many bytes, which nobody reads.
    struct Large(i64);

    impl Change for Large {
        type Answer = ();

        async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
            let write = sqlx::query(
                "INSERT INTO pulse (id, at, room) VALUES (1, 0, zeroblob(?)) ON CONFLICT DO UPDATE SET room = excluded.room",
            );
            write.bind(self.0).execute(&mut work.conn).await.map_err(store::StoreError::from)?;
            Ok(())
        }
    }

    /// Lets the file have so many pages.
    struct Room(i64);

    impl Change for Room {
        type Answer = ();

        async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
            let set = format!("PRAGMA max_page_count = {}", self.0);
            sqlx::query(sqlx::AssertSqlSafe(set))
                .execute(&mut work.conn)
                .await
                .map_err(store::StoreError::from)?;
            Ok(())
        }
    }

    #[tokio::test]
    async fn what_has_room_for_a_row_and_for_nothing_else_is_not_ready() {
        let folder = tempfile::tempdir().unwrap();
        let conn = store::writer(&folder.path().join("db.sqlite3")).await.unwrap();
        let (writer, _) = Writer::start((conn, None), Clock::manual(1_000).0, Wakes::default());
        writer.change(Room(1)).await.unwrap(); // as many as it has
        writer.change(Ping).await.unwrap();
        let full = |answer: Result<(), TrainingError>| {
            assert_eq!(answer.unwrap_err().trouble(), Some(Trouble::Full));
        };
        full(writer.change(Large(1 << 18)).await);
        for _ in 0..3 {
            full(writer.change(Ping).await);
        }
        writer.change(Room(1 << 20)).await.unwrap();
        writer.change(Ping).await.unwrap();
        writer.change(Large(1 << 18)).await.unwrap();
    }
}
