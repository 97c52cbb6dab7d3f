//! Input of critique jobs: the scenarios and action logs of their episodes, read in a few statements.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use env_core::{ActionLog, Scenario};
use sqlx::SqliteConnection;
use store::critiques::CritiqueJob;
use store::groups::{self, GroupRow};
use store::keys::{EpisodeKey, GroupKey};
use store::scenarios::{LoadedScenarios, ScenarioLoader};
use store::{StoreError, episodes};

use crate::critiques::sampling;

/// Episodes criticised together: enough to share a commit, and few enough that little is repeated after a crash.
const MAX_EPISODES: usize = 64;

/// An episode to criticise.
#[derive(Debug)]
pub(crate) struct CritiqueEpisode {
    pub(crate) scenario: Scenario,
    /// Number of the layout of a designed group.
    pub(crate) layout: Option<i64>,
    pub(crate) log: ActionLog,
}

/// An episode that sampling selected.
#[derive(Debug)]
pub(crate) struct SelectedEpisode {
    /// Index of the episode in its lease.
    pub(crate) number: i64,
    /// The episode, or the reason why it cannot be read.
    pub(crate) episode: Result<CritiqueEpisode, String>,
}

/// A critique job with the episodes to criticise.
#[derive(Debug)]
pub struct CritiqueInput {
    pub(crate) job: CritiqueJob,
    pub(crate) selected: Vec<SelectedEpisode>,
    /// Number of episodes that sampling left out.
    pub(crate) skipped: i64,
}

/// Loads jobs until they have enough episodes. Of each run the share that remains after its `halvings` is selected. An episode that
/// cannot be read fails by itself.
///
/// # Errors
/// Returns an error of the store if a statement fails.
pub async fn load(
    conn: &mut SqliteConnection,
    jobs: Vec<CritiqueJob>,
    halvings: &BTreeMap<String, u32>,
) -> Result<Vec<CritiqueInput>, StoreError> {
    let mut loaded = Vec::new();
    let mut loader = EpisodeLoader::default();
    for job in jobs {
        let halvings = halvings.get(&job.run).copied().unwrap_or(0);
        let numbers = job.numbers().map_err(|error| error.to_string());
        let selected = numbers.map(|mut numbers| {
            numbers.retain(|number| sampling::is_selected(job.lease, *number, halvings));
            numbers
        });
        for number in selected.iter().flatten() {
            loader.needed.insert(EpisodeKey { lease: job.lease, number: *number });
            loader.groups.entry(job.lease).or_default().insert(number / job.group_size.max(1));
        }
        loaded.push((job, selected));
        if loader.needed.len() >= MAX_EPISODES {
            break;
        }
    }
    loader.read(conn).await?;
    Ok(loaded.into_iter().map(|(job, selected)| loader.input(job, selected)).collect())
}

/// Groups, scenarios and logs of the selected episodes.
#[derive(Default)]
struct EpisodeLoader {
    needed: BTreeSet<EpisodeKey>,
    /// Numbers of the needed groups, by lease.
    groups: BTreeMap<i64, BTreeSet<i64>>,
    rows: HashMap<GroupKey, GroupRow>,
    scenarios: LoadedScenarios,
    logs: HashMap<EpisodeKey, Result<ActionLog, StoreError>>,
}

impl EpisodeLoader {
    async fn read(&mut self, conn: &mut SqliteConnection) -> Result<(), StoreError> {
        for (lease, numbers) in &self.groups {
            let numbers: Vec<i64> = numbers.iter().copied().collect();
            for row in groups::get_many(conn, *lease, &numbers).await? {
                self.rows.insert(GroupKey { lease: *lease, number: row.number }, row);
            }
        }
        let ids: BTreeSet<&[u8]> = self.rows.values().map(|row| row.scenario.as_slice()).collect();
        self.scenarios = ScenarioLoader::default().all(conn, &ids.into_iter().collect::<Vec<_>>()).await?;
        let needed: Vec<_> = self.needed.iter().copied().collect();
        self.logs = episodes::logs(conn, &needed).await?;
        Ok(())
    }

    fn input(&self, job: CritiqueJob, selected: Result<Vec<i64>, String>) -> CritiqueInput {
        let selected: Vec<_> = match selected {
            Ok(numbers) => {
                let select = |number| SelectedEpisode { number, episode: self.episode(&job, number) };
                numbers.into_iter().map(select).collect()
            }
            // The stored list of episodes is unreadable: every episode of the job fails.
            Err(why) => {
                let unreadable = || SelectedEpisode { number: 0, episode: Err(why.clone()) };
                (0..job.episodes).map(|_| unreadable()).collect()
            }
        };
        let skipped = job.episodes - selected.len() as i64;
        CritiqueInput { job, selected, skipped }
    }

    fn episode(&self, job: &CritiqueJob, number: i64) -> Result<CritiqueEpisode, String> {
        let gone = |what: &str| format!("{what} is missing in the database");
        let group = GroupKey { lease: job.lease, number: number / job.group_size.max(1) };
        let row = self.rows.get(&group).ok_or_else(|| gone("a group"))?;
        let scenario = self.scenarios.get(&row.scenario).map_err(|error| error.to_string())?.clone();
        let episode = EpisodeKey { lease: job.lease, number };
        let log = self.logs.get(&episode).ok_or_else(|| gone("an action log"))?;
        let log = log.as_ref().map_err(ToString::to_string)?.clone();
        Ok(CritiqueEpisode { scenario, layout: row.layout, log })
    }
}
