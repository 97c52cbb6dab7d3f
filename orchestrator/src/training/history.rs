//! What comes of a run over time: counted by changes, written once at the end of their transaction.

use std::collections::BTreeMap;

use sqlx::SqliteConnection;

use super::mind::Mind;
use super::{Change, TrainingError, Work};
use crate::clock::Millis;
use crate::ids::RunId;
use crate::store::StoreError;
use crate::store::history::{self, Part, Point, Standing};
use crate::store::sums::Sums;
use curriculum::{Mastery, TaskStatus};

/// How often it is looked where a run's tasks stand: quantiles take a while, and many transactions come in a second.
const LOOK: Millis = 2_000;

/// What came of runs' tasks.
#[derive(Debug, Default)]
pub(super) struct Counts(pub(super) BTreeMap<String, BTreeMap<String, Part>>);

impl Counts {
    /// Of one task.
    pub(super) fn of(&mut self, run: &str, task: &str) -> &mut Part {
        if !self.0.contains_key(run) {
            self.0.insert(run.to_owned(), BTreeMap::new());
        }
        let tasks = self.0.entry(run.to_owned()).or_default();
        tasks.entry(task.to_owned()).or_default()
    }

    /// Groups of one task whose blind panel was looked at.
    pub(super) fn panels(&self, run: &str, task: &str) -> i64 {
        self.0.get(run).and_then(|tasks| tasks.get(task)).map_or(0, |part| part.panels)
    }

    /// Takes others.
    pub(super) fn join(&mut self, other: &mut Self) {
        for (run, tasks) in std::mem::take(&mut other.0) {
            for (task, part) in tasks {
                self.of(&run, &task).join(&part);
            }
        }
    }
}

impl Part {
    /// Counts episodes.
    pub(super) fn add(&mut self, sums: &Sums, level: Option<i64>) {
        self.episodes += sums.episodes;
        self.successes += sums.successes;
        self.score += sums.score;
        self.skilled += sums.skilled;
        self.skill += sums.skill;
        self.failed += sums.failed;
        self.expired += sums.expired;
        // What never came back is of no level that came back.
        if sums.episodes + sums.failed > 0 {
            self.at_level(level);
        }
    }
}

/// When a run's history was last seen to.
#[derive(Debug, Default)]
pub(super) struct SeenTo {
    /// Where its tasks stand was looked at.
    looked: Option<Millis>,
    /// The levels that it saw.
    levels: Vec<Option<u32>>,
}

impl SeenTo {
    /// Writes what came of a run, and now and then where its tasks stand.
    pub(super) async fn write(
        &mut self,
        conn: &mut SqliteConnection,
        (run, mind): (&str, Option<&Mind>),
        mut parts: BTreeMap<String, Part>,
        now: Millis,
    ) -> Result<(), StoreError> {
        // A new level is worth a look at once.
        let moved = mind.is_some_and(|mind| self.levels != levels(mind));
        if let Some(mind) = mind.filter(|_| due(&mut self.looked, LOOK, now) || moved) {
            self.levels = levels(mind);
            // Of all its tasks, not of those alone of which something came just now: who looks wants to know where they stand.
            for (task, standing) in standings(mind) {
                parts.entry(task).or_default().standing = Some(standing);
            }
        }
        let parts: Vec<_> = parts.into_iter().collect();
        history::add(conn, run, now, &parts).await
    }
}

/// Forgets minutes of a run that are in its hours, too.
#[derive(Debug)]
pub struct ForgetMinutes {
    /// The run.
    pub run: String,
}

/// Rows deleted in one change.
const FORGOTTEN: i64 = 500;

impl Change for ForgetMinutes {
    /// Whether there may be more.
    type Answer = bool;
    const BULK: bool = true;

    async fn apply(self, work: &mut Work) -> Result<bool, TrainingError> {
        let now = work.now;
        Ok(history::forget_minutes(&mut work.conn, &self.run, now, FORGOTTEN).await?)
    }
}

/// Whether it is so long ago, by a clock that may jump; it is not any more.
fn due(last: &mut Option<Millis>, every: Millis, now: Millis) -> bool {
    let due = last.is_none_or(|last| (now - last).abs() >= every);
    if due {
        *last = Some(now);
    }
    due
}

/// The levels of a run's tasks.
fn levels(mind: &Mind) -> Vec<Option<u32>> {
    mind.curriculum.status().into_iter().map(|status| status.level).collect()
}

/// Where a run's tasks stand.
fn standings(mind: &Mind) -> BTreeMap<String, Standing> {
    standing(&mind.curriculum.status(), &mind.curriculum.mastery())
}

/// Where tasks stand, as their history has it.
#[must_use]
pub fn standing(status: &[TaskStatus], mastery: &[Mastery]) -> BTreeMap<String, Standing> {
    let of = |status: &TaskStatus| {
        let held = mastery.iter().find(|held| held.task == status.task && held.level == status.level);
        let level = status.level.map(i64::from);
        // Of a level without evidence it is known as little as of any: Beta(1, 1).
        let (mean, q10, q90) = held.map_or((0.5, 0.1, 0.9), |held| (held.mean, held.q10, held.q90));
        let known = held.is_some() || level.is_some();
        known.then(|| (status.task.clone(), Standing { level, mean, q10, q90 }))
    };
    status.iter().filter_map(of).collect()
}

/// Has the last point of each task tell where it stands now: it was looked at up to some seconds before the last results came.
pub fn bring_up(points: &mut [Point], now: &BTreeMap<String, Standing>) {
    for at in 0..points.len() {
        let last = points.get(at + 1).is_none_or(|next| next.task != points[at].task);
        if let Some(standing) = now.get(&points[at].task).filter(|_| last) {
            points[at].part.standing = Some(*standing);
        }
    }
}

/// Asks where a run's tasks stand now, as their history has it.
#[derive(Debug)]
pub struct StandingNow {
    /// Which run.
    pub run: RunId,
}

impl Change for StandingNow {
    type Answer = BTreeMap<String, Standing>;

    async fn apply(self, work: &mut Work) -> Result<Self::Answer, TrainingError> {
        let (mind, _) = work.mind(self.run.as_str()).await?;
        Ok(standings(mind))
    }
}
