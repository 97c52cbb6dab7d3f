//! What is needed to criticise episodes: their scenarios and action logs, read in a few statements however many they are.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use env_core::{ActionLog, Scenario};
use sqlx::SqliteConnection;

use crate::critiques::sampling;
use crate::store::critiques::CritiqueJob;
use crate::store::groups::{self, GroupRow};
use crate::store::keys::{EpisodeKey, GroupKey};
use crate::store::scenarios::{ScenarioLoader, LoadedScenarios};
use crate::store::{StoreError, episodes};

/// Episodes criticised at a time: enough to share a commit, few enough that it is short and little is done again after a
/// crash.
const EPISODES: usize = 64;

/// What an episode is criticised on.
#[derive(Debug)]
pub(crate) struct CritiqueEpisode {
    pub(crate) scenario: Scenario,
    /// The layout of a designed group.
    pub(crate) layout: Option<i64>,
    pub(crate) log: ActionLog,
}

/// A job with what is needed to do it.
#[derive(Debug)]
pub struct CritiqueInput {
    pub(crate) job: CritiqueJob,
    /// What is criticised, by index in the lease.
    pub(crate) chosen: Vec<(i64, Result<CritiqueEpisode, String>)>,
    pub(crate) skipped: i64,
}

/// Loads jobs until enough episodes are together, of each run the share that so many halvings leave. An episode that cannot
/// be read back fails by itself.
///
/// # Errors
/// The database's.
pub async fn load(
    conn: &mut SqliteConnection,
    jobs: Vec<CritiqueJob>,
    halvings: &BTreeMap<String, u32>,
) -> Result<Vec<CritiqueInput>, StoreError> {
    let mut picked = Vec::new();
    let mut shelf = CritiqueScenarios::default();
    for job in jobs {
        let halvings = halvings.get(&job.run).copied().unwrap_or(0);
        let numbers = job.numbers().map_err(|error| error.to_string());
        let kept = numbers.map(|mut numbers| {
            numbers.retain(|number| sampling::kept(job.lease, *number, halvings));
            numbers
        });
        for number in kept.iter().flatten() {
            shelf.wanted.insert(EpisodeKey { lease: job.lease, number: *number });
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
struct CritiqueScenarios {
    wanted: BTreeSet<EpisodeKey>,
    groups: BTreeMap<i64, BTreeSet<i64>>,
    rows: HashMap<GroupKey, GroupRow>,
    scenarios: LoadedScenarios,
    logs: HashMap<EpisodeKey, Result<ActionLog, StoreError>>,
}

impl CritiqueScenarios {
    async fn fill(&mut self, conn: &mut SqliteConnection) -> Result<(), StoreError> {
        for (lease, numbers) in &self.groups {
            let numbers: Vec<i64> = numbers.iter().copied().collect();
            for row in groups::get_many(conn, *lease, &numbers).await? {
                self.rows.insert(GroupKey { lease: *lease, number: row.number }, row);
            }
        }
        let ids: BTreeSet<&[u8]> = self.rows.values().map(|row| row.scenario.as_slice()).collect();
        self.scenarios = ScenarioLoader::default().all(conn, &ids.into_iter().collect::<Vec<_>>()).await?;
        let wanted: Vec<_> = self.wanted.iter().copied().collect();
        self.logs = episodes::logs(conn, &wanted).await?;
        Ok(())
    }

    fn material(&self, job: CritiqueJob, kept: Result<Vec<i64>, String>) -> CritiqueInput {
        let chosen: Vec<_> = match kept {
            Ok(numbers) => numbers.into_iter().map(|number| (number, self.stage(&job, number))).collect(),
            // Its list of episodes was changed by hand: all of them fail.
            Err(why) => (0..job.episodes).map(|_| (0, Err(why.clone()))).collect(),
        };
        let skipped = job.episodes - chosen.len() as i64;
        CritiqueInput { job, chosen, skipped }
    }

    fn stage(&self, job: &CritiqueJob, number: i64) -> Result<CritiqueEpisode, String> {
        let gone = |what: &str| format!("{what} in the database is gone");
        let group = GroupKey { lease: job.lease, number: number / job.group_size.max(1) };
        let row = self.rows.get(&group).ok_or_else(|| gone("a group"))?;
        let scenario = self.scenarios.get(&row.scenario).map_err(|error| error.to_string())?.clone();
        let episode = EpisodeKey { lease: job.lease, number };
        let log = self.logs.get(&episode).ok_or_else(|| gone("an action log"))?;
        let log = log.as_ref().map_err(ToString::to_string)?.clone();
        Ok(CritiqueEpisode { scenario, layout: row.layout, log })
    }
}
