//! Looking at a run: where its tasks stand. Asked of the writer, which has it in memory; it changes nothing.

use super::{Change, RunSettings, TrainingError, Work};
use crate::curriculum::{Explanation, Mastery, TaskStatus};
use crate::ids::RunId;
use crate::store::columns::{self, ClaimedSums};
use crate::store::pulse;
use crate::store::sums::{self, Sums};

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
    /// Events so far.
    pub next_seq: u64,
}

impl Change for Look {
    type Answer = Standing;

    async fn apply(self, work: &mut Work) -> Result<Standing, TrainingError> {
        let (mind, conn) = work.mind(self.run.as_str()).await?;
        Ok(Standing {
            settings: mind.settings.clone(),
            status: mind.curriculum.status(),
            mastery: mind.curriculum.mastery(),
            explanation: mind.curriculum.explain(),
            sums: sums::of_run(conn, self.run.as_str(), false).await?,
            designed: sums::of_run(conn, self.run.as_str(), true).await?,
            claimed: columns::sums(conn, self.run.as_str()).await?,
            next_seq: mind.curriculum.next_seq(),
        })
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

/// Asks where the runs stand that are in memory, and whether the database can be written: it writes.
#[derive(Debug)]
pub struct Gauges;

/// Runs that are told of at most: each has series of its own wherever they are kept.
const RUNS: usize = 100;

impl Change for Gauges {
    type Answer = Vec<Gauge>;
    const BULK: bool = true;

    async fn apply(self, work: &mut Work) -> Result<Vec<Gauge>, TrainingError> {
        pulse::beat(&mut work.conn, work.now).await?;
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

/// Writes that it was there: the answer says that the writer can write.
#[derive(Debug)]
pub struct Ping;

impl Change for Ping {
    type Answer = ();

    async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
        Ok(pulse::beat(&mut work.conn, work.now).await?)
    }
}
