//! What is needed to criticise episodes: their scenarios and action logs, read in a few statements however many they are.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use env_core::{ActionLog, Scenario};
use sqlx::SqliteConnection;

use super::super::sample;
use crate::store::critiques::Job;
use crate::store::groups::{self, GroupRow};
use crate::store::scenarios::{Loader, Scenarios};
use crate::store::{StoreError, episodes};

/// Episodes criticised at a time: enough to share a commit, few enough that it is short and little is done again after a
/// crash.
const EPISODES: usize = 64;

/// What an episode is criticised on.
#[derive(Debug)]
pub(super) struct Stage {
    pub(super) scenario: Scenario,
    /// The layout of a designed group.
    pub(super) layout: Option<i64>,
    pub(super) log: ActionLog,
}

/// A job with what is needed to do it.
#[derive(Debug)]
pub struct Material {
    pub(super) job: Job,
    /// What is criticised, by index in the lease.
    pub(super) chosen: Vec<(i64, Result<Stage, String>)>,
    pub(super) skipped: i64,
}

/// Loads jobs until enough episodes are together, of each run the share that so many halvings leave. An episode that cannot
/// be read back fails by itself.
///
/// # Errors
/// The database's.
pub async fn load(
    conn: &mut SqliteConnection,
    jobs: Vec<Job>,
    halvings: &BTreeMap<String, u32>,
) -> Result<Vec<Material>, StoreError> {
    let mut picked = Vec::new();
    let mut shelf = Shelf::default();
    for job in jobs {
        let halvings = halvings.get(&job.run).copied().unwrap_or(0);
        let numbers = job.numbers().map_err(|error| error.to_string());
        let kept = numbers.map(|mut numbers| {
            numbers.retain(|number| sample::kept(job.lease, *number, halvings));
            numbers
        });
        for number in kept.iter().flatten() {
            shelf.wanted.insert((job.lease, *number));
            shelf.groups.entry(job.lease).or_default().insert(number / job.group_size.max(1));
        }
        picked.push((job, kept));
        if shelf.wanted.len() >= EPISODES {
            break;
        }
    }
    shelf.fill(conn).await?;
    Ok(picked.into_iter().map(|(job, kept)| shelf.material(job, kept)).collect())
}

/// What was read, to be handed out.
#[derive(Default)]
struct Shelf {
    wanted: BTreeSet<(i64, i64)>,
    groups: BTreeMap<i64, BTreeSet<i64>>,
    rows: HashMap<(i64, i64), GroupRow>,
    scenarios: Scenarios,
    logs: HashMap<(i64, i64), Result<ActionLog, StoreError>>,
}

impl Shelf {
    async fn fill(&mut self, conn: &mut SqliteConnection) -> Result<(), StoreError> {
        for (lease, numbers) in &self.groups {
            let numbers: Vec<i64> = numbers.iter().copied().collect();
            for row in groups::some(conn, *lease, &numbers).await? {
                self.rows.insert((*lease, row.number), row);
            }
        }
        let ids: BTreeSet<&[u8]> = self.rows.values().map(|row| row.scenario.as_slice()).collect();
        self.scenarios = Loader::default().all(conn, &ids.into_iter().collect::<Vec<_>>()).await?;
        let wanted: Vec<_> = self.wanted.iter().copied().collect();
        self.logs = episodes::logs(conn, &wanted).await?;
        Ok(())
    }

    fn material(&self, job: Job, kept: Result<Vec<i64>, String>) -> Material {
        let chosen: Vec<_> = match kept {
            Ok(numbers) => numbers.into_iter().map(|number| (number, self.stage(&job, number))).collect(),
            // Its list of episodes was changed by hand: all of them fail.
            Err(why) => (0..job.episodes).map(|_| (0, Err(why.clone()))).collect(),
        };
        let skipped = job.episodes - chosen.len() as i64;
        Material { job, chosen, skipped }
    }

    fn stage(&self, job: &Job, number: i64) -> Result<Stage, String> {
        let gone = |what: &str| format!("{what} in the database is gone");
        let row =
            self.rows.get(&(job.lease, number / job.group_size.max(1))).ok_or_else(|| gone("a group"))?;
        let scenario = self.scenarios.get(&row.scenario).map_err(|error| error.to_string())?.clone();
        let log = self.logs.get(&(job.lease, number)).ok_or_else(|| gone("an action log"))?;
        let log = log.as_ref().map_err(ToString::to_string)?.clone();
        Ok(Stage { scenario, layout: row.layout, log })
    }
}
