//! Replaying what trainers report: score, skill and success come from the actions, never from the client.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use env_core::bracket::{Bracket, Flown, admit, success};
use env_core::log::Precision;
use env_core::rollout::{ReplayError, read_log, replay};
use env_core::{ActionLog, Scenario, Stopped};
use rayon::ThreadPool;
use rayon::prelude::*;
use serde_json::Value;
use sqlx::SqliteConnection;

use super::TrainingError;
use super::sets::Sets;
use super::settings::RunSettings;
use crate::ids::{EpisodeId, LeaseId, RunId};
use crate::store::episodes::StoredLog;
use crate::store::folds::{self, FoldedLease};
use crate::store::leases::LeaseRow;
use crate::store::{StoreError, groups, leases};

/// What a trainer says of one episode.
#[derive(Debug, Clone)]
pub struct Claim {
    /// Which episode, as it was written.
    pub episode: String,
    /// What happened.
    pub what: Claimed,
    /// The policy that flew it; the lease's if none.
    pub policy_version: Option<u32>,
    /// What the trainer logged: JSON.
    pub metrics: Option<String>,
}

/// What happened to an episode, as claimed.
#[derive(Debug, Clone)]
pub enum Claimed {
    /// It was flown.
    Finished {
        /// The steps in the task's wire form.
        steps: Vec<Value>,
        /// The precision they were taken in.
        precision: Precision,
        /// Why they end early, if they do.
        stopped: Option<Stopped>,
    },
    /// It was flown here, by this log.
    Logged(ActionLog),
    /// The infrastructure lost it.
    Failed {
        /// Why, in the trainer's words.
        reason: String,
    },
    /// The claim contradicts itself.
    Refused {
        /// A word for programs.
        code: &'static str,
        /// A sentence for people.
        detail: String,
    },
}

/// A claim, looked up and replayed.
#[derive(Debug, Clone)]
pub struct Audited {
    /// Which episode, as it was written.
    pub episode: String,
    /// Its lease and index, where they exist in this run.
    pub place: Option<(i64, i64)>,
    /// The policy that flew it.
    pub policy_version: Option<u32>,
    /// What the trainer logged: JSON.
    pub metrics: Option<String>,
    /// What the replay says.
    pub verdict: Verdict,
}

/// What the replay says.
#[derive(Debug, Clone)]
pub enum Verdict {
    /// It was flown, and this is what it earned.
    Flown {
        /// How it went.
        flown: Flown,
        /// Against floor and reference.
        skill: Option<f64>,
        /// By the run's rule.
        success: bool,
        /// The bracket's floor.
        floor: f64,
        /// The bracket's reference score.
        reference: f64,
        /// The bracket's planner.
        planner: u32,
        /// The log as it is stored.
        log: StoredLog,
    },
    /// It failed.
    Failed(String),
    /// It was reported before, and how it came out is all that is kept of it.
    Known {
        /// The score.
        score: Option<f64>,
        /// Against floor and reference.
        skill: Option<f64>,
        /// By the run's rule.
        success: Option<bool>,
    },
    /// It cannot be taken.
    Refused {
        /// A word for programs.
        code: &'static str,
        /// A sentence for people.
        detail: String,
    },
}

/// A group whose scenario was bracketed only now: one of a lease of columns.
#[derive(Debug, Clone)]
pub struct Found {
    /// Its lease, and its number there.
    pub group: (i64, i64),
    /// The scenario.
    pub scenario: Scenario,
    /// What it is worth.
    pub bracket: Bracket,
    /// Whether acting well matters on it.
    pub contested: bool,
}

/// A group with what is needed to replay its episodes.
struct Stage {
    scenario: Scenario,
    /// None where nobody has looked for it yet.
    bracket: Option<Bracket>,
}

/// Looks every claim up, and replays them in parallel on these threads.
///
/// # Errors
/// The store's. A claim that is wrong is refused by itself.
pub async fn audit(
    conn: &mut SqliteConnection,
    threads: &Arc<ThreadPool>,
    (run, settings): (&RunId, RunSettings),
    claims: Vec<Claim>,
) -> Result<(Vec<Audited>, Vec<Found>), TrainingError> {
    let mut finder = Finder::new(run);
    let mut places = Vec::with_capacity(claims.len());
    // As things stand at one moment: what is folded in between would be neither here nor there.
    let mut moment = sqlx::Connection::begin(conn).await.map_err(StoreError::from)?;
    for claim in &claims {
        places.push(finder.place(&mut moment, &claim.episode).await?);
    }
    finder.load(&mut moment).await?;
    moment.rollback().await.map_err(StoreError::from)?; // nothing was written
    for place in &mut places {
        finder.check(place);
    }
    let mut stages = finder.stages;
    let threads = Arc::clone(threads);
    let audited = tokio::task::spawn_blocking(move || {
        threads.install(|| {
            let found = bracket(&mut stages);
            let audited = claims.into_par_iter().zip(places);
            let audited = audited.map(|(claim, place)| judge(claim, place, &stages, &settings)).collect();
            (audited, found)
        })
    });
    audited.await.map_err(|error| TrainingError::invalid("results", error.to_string()))
}

/// Brackets what has none yet.
fn bracket(stages: &mut HashMap<(i64, i64), Stage>) -> Vec<Found> {
    let bare: Vec<_> = stages.iter_mut().filter(|(_, stage)| stage.bracket.is_none()).collect();
    let found = bare.into_par_iter().filter_map(|(group, stage)| {
        let admission = admit(&stage.scenario);
        let bracket = admission.bracket?;
        stage.bracket = Some(bracket.clone());
        let (group, scenario) = (*group, stage.scenario.clone());
        Some(Found { group, scenario, bracket, contested: admission.contested })
    });
    found.collect()
}

/// (lease, index, group), or what is to be said without them.
type Place = Result<(i64, i64, i64), Verdict>;

struct Finder<'a> {
    run: &'a RunId,
    leases: HashMap<LeaseId, Result<LeaseRow, (&'static str, String)>>,
    /// Leases past what the run keeps whole.
    folded: HashMap<i64, FoldedLease>,
    /// Groups that are needed, by lease, and whether it is one of columns.
    wanted: BTreeMap<i64, (bool, BTreeSet<i64>)>,
    stages: HashMap<(i64, i64), Stage>,
}

impl<'a> Finder<'a> {
    fn new(run: &'a RunId) -> Self {
        Self {
            run,
            leases: HashMap::new(),
            folded: HashMap::new(),
            wanted: BTreeMap::new(),
            stages: HashMap::new(),
        }
    }

    /// (lease, index, group) of an episode, as far as its lease tells; or why there is none.
    async fn place(&mut self, conn: &mut SqliteConnection, name: &str) -> Result<Place, TrainingError> {
        let id: EpisodeId = match name.parse() {
            Ok(id) => id,
            Err(error) => return Ok(Err(refused("bad_id", error.to_string()))),
        };
        let lease = match self.lease(conn, &id.lease).await? {
            Ok(lease) => lease,
            Err((code, detail)) => return Ok(Err(refused(code, detail))),
        };
        if id.index >= lease.episodes() {
            let last = lease.episodes() - 1;
            return Ok(Err(refused("unknown_episode", format!("the lease's episodes are 0 to {last}"))));
        }
        let group = id.index / lease.group_size;
        if lease.folded != 0 && groups::get(conn, lease.id, group).await?.is_none() {
            return Ok(Err(self.folded(conn, &lease, id.index).await?));
        }
        let (_, groups) =
            self.wanted.entry(lease.id).or_insert_with(|| (lease.is_columns(), BTreeSet::new()));
        groups.insert(group);
        Ok(Ok((lease.id, id.index, group)))
    }

    /// What is to be said of an episode of which only is kept how it came out.
    async fn folded(
        &mut self,
        conn: &mut SqliteConnection,
        lease: &LeaseRow,
        index: i64,
    ) -> Result<Verdict, TrainingError> {
        if !self.folded.contains_key(&lease.id)
            && let Some(folded) = folds::get(conn, self.run.as_str(), lease.id).await?
        {
            self.folded.insert(lease.id, folded);
        }
        Ok(past(self.folded.get(&lease.id), index))
    }

    /// Loads what the groups that are needed are flown and judged by.
    async fn load(&mut self, conn: &mut SqliteConnection) -> Result<(), TrainingError> {
        let mut rows = Vec::new();
        for (lease, (columns, groups)) in &self.wanted {
            let groups: Vec<i64> = groups.iter().copied().collect();
            let of_lease = groups::some(conn, *lease, &groups).await?;
            rows.extend(of_lease.into_iter().map(|row| ((*lease, row.number), *columns, row.scenario)));
        }
        let ids: BTreeSet<&[u8]> = rows.iter().map(|(.., id)| id.as_slice()).collect();
        let ids: Vec<_> = ids.into_iter().collect();
        let sets = Sets::of(conn, &ids).await?;
        for (group, of_columns, id) in rows {
            let (scenario, bracket) = sets.get(&id, of_columns)?;
            self.stages.insert(group, Stage { scenario: scenario.clone(), bracket: bracket.cloned() });
        }
        Ok(())
    }

    /// Refuses an episode whose group was not found.
    fn check(&self, place: &mut Place) {
        let Ok((lease, _, group)) = *place else { return };
        if !self.stages.contains_key(&(lease, group)) {
            let columns = self.wanted.get(&lease).is_some_and(|(columns, _)| *columns);
            let why = if columns {
                "it is not audited: only the columns say how it went"
            } else {
                "the lease has no such group"
            };
            *place = Err(refused("unknown_episode", why.to_owned()));
        }
    }

    async fn lease(
        &mut self,
        conn: &mut SqliteConnection,
        id: &LeaseId,
    ) -> Result<Result<LeaseRow, (&'static str, String)>, TrainingError> {
        if let Some(known) = self.leases.get(id) {
            return Ok(known.clone());
        }
        let row = match leases::get(conn, id.number).await? {
            None => folds::get(conn, self.run.as_str(), id.number).await?.map(|folded| folded.row),
            row => row,
        };
        let found = match row.filter(|row| row.token == id.token) {
            None => Err(("unknown_episode", format!("there is no lease {id}"))),
            Some(row) if row.run != self.run.as_str() => {
                Err(("foreign_episode", format!("lease {id} is not one of run {}", self.run)))
            }
            Some(row) => Ok(row),
        };
        self.leases.insert(id.clone(), found.clone());
        Ok(found)
    }
}

/// What is to be said of an episode of a lease of which nothing is kept but how its episodes came out.
pub(super) fn past(lease: Option<&FoldedLease>, index: i64) -> Verdict {
    let Some((_, known)) = lease.and_then(|folded| folded.episode(index)) else {
        let why = "its lease is over, and what it was to be flown on is kept no longer";
        return refused("expired", why.to_owned());
    };
    Verdict::Known { score: known.score, skill: known.skill, success: known.success }
}

const fn refused(code: &'static str, detail: String) -> Verdict {
    Verdict::Refused { code, detail }
}

fn judge(claim: Claim, place: Place, stages: &HashMap<(i64, i64), Stage>, settings: &RunSettings) -> Audited {
    let Claim { episode, what, policy_version, metrics } = claim;
    let (place, verdict) = match place {
        Err(verdict) => (None, verdict),
        Ok((lease, index, group)) => {
            let verdict = match (what, stages.get(&(lease, group))) {
                (Claimed::Failed { reason }, _) => Verdict::Failed(reason),
                (Claimed::Refused { code, detail }, _) => Verdict::Refused { code, detail },
                (Claimed::Finished { steps, precision, stopped }, Some(stage)) => {
                    fly(stage, settings, &steps, precision, stopped)
                }
                (Claimed::Logged(log), Some(stage)) => judge_log(stage, settings, &log),
                (Claimed::Finished { .. } | Claimed::Logged(_), None) => {
                    Verdict::Refused { code: "unknown_episode", detail: "its scenario is gone".to_owned() }
                }
            };
            (Some((lease, index)), verdict)
        }
    };
    Audited { episode, place, policy_version, metrics, verdict }
}

fn fly(
    stage: &Stage,
    settings: &RunSettings,
    steps: &[Value],
    precision: Precision,
    stopped: Option<Stopped>,
) -> Verdict {
    match read_log(&stage.scenario, steps, precision, stopped) {
        Ok(log) => judge_log(stage, settings, &log),
        Err(error) => invalid(error.into()),
    }
}

fn invalid(error: ReplayError) -> Verdict {
    let detail = match error {
        ReplayError::Log(error) => error.under("actions").to_string(),
        ReplayError::Scenario(error) => error.to_string(),
    };
    Verdict::Refused { code: "invalid_log", detail }
}

fn judge_log(stage: &Stage, settings: &RunSettings, log: &ActionLog) -> Verdict {
    let Stage { scenario, bracket: Some(bracket) } = stage else {
        return Verdict::Refused { code: "invalid_log", detail: "its scenario cannot be flown".to_owned() };
    };
    let flown = match replay(scenario, log) {
        Ok(flown) => flown,
        Err(error) => return invalid(error),
    };
    let rule = settings.rule(scenario.task().id());
    Verdict::Flown {
        skill: bracket.skill(flown.score),
        success: success(scenario, rule, bracket, &flown),
        floor: bracket.floor,
        reference: bracket.reference.score,
        planner: bracket.planner,
        log: StoredLog::of(log),
        flown,
    }
}
