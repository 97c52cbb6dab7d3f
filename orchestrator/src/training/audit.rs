//! Replaying what trainers report: score, skill and success come from the actions, never from the client.

use std::collections::HashMap;

use env_core::bracket::{Bracket, Flown, admit, success};
use env_core::log::Precision;
use env_core::rollout::{ReplayError, read_log, replay};
use env_core::{ActionLog, Scenario, Stopped};
use rayon::prelude::*;
use serde_json::Value;
use sqlx::SqliteConnection;

use super::TrainingError;
use super::settings::RunSettings;
use crate::ids::{EpisodeId, LeaseId, RunId};
use crate::store::leases::{GroupRow, LeaseRow};
use crate::store::{self, brackets, leases, scenarios::Loader};

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
        log: Vec<u8>,
    },
    /// It failed.
    Failed(String),
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

/// Looks every claim up, and replays them in parallel.
///
/// # Errors
/// The store's. A claim that is wrong is refused by itself.
pub async fn audit(
    conn: &mut SqliteConnection,
    run: &RunId,
    settings: RunSettings,
    claims: Vec<Claim>,
) -> Result<(Vec<Audited>, Vec<Found>), TrainingError> {
    let mut finder = Finder::new(run);
    let mut places = Vec::with_capacity(claims.len());
    for claim in &claims {
        places.push(finder.place(conn, &claim.episode).await?);
    }
    let mut stages = finder.stages;
    let audited = tokio::task::spawn_blocking(move || {
        let found = bracket(&mut stages);
        let audited = claims.into_par_iter().zip(places);
        let audited = audited.map(|(claim, place)| judge(claim, place, &stages, &settings)).collect();
        (audited, found)
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

type Place = Result<(i64, i64, i64), (&'static str, String)>;

struct Finder<'a> {
    run: &'a RunId,
    leases: HashMap<LeaseId, Result<LeaseRow, (&'static str, String)>>,
    stages: HashMap<(i64, i64), Stage>,
    loader: Loader,
}

impl<'a> Finder<'a> {
    fn new(run: &'a RunId) -> Self {
        Self { run, leases: HashMap::new(), stages: HashMap::new(), loader: Loader::default() }
    }

    /// (lease, index, group) of an episode, with its stage loaded; or why there is none.
    async fn place(&mut self, conn: &mut SqliteConnection, name: &str) -> Result<Place, TrainingError> {
        let id: EpisodeId = match name.parse() {
            Ok(id) => id,
            Err(error) => return Ok(Err(("bad_id", format!("{error}")))),
        };
        let lease = match self.lease(conn, &id.lease).await? {
            Ok(lease) => lease,
            Err(why) => return Ok(Err(why)),
        };
        if id.index >= lease.groups * lease.group_size {
            let last = lease.groups * lease.group_size - 1;
            return Ok(Err(("unknown_episode", format!("the lease's episodes are 0 to {last}"))));
        }
        let group = id.index / lease.group_size;
        if !self.stages.contains_key(&(lease.id, group)) {
            let Some(row) = leases::group(conn, lease.id, group).await? else {
                let why = if lease.is_columns() {
                    "it is not audited: only the columns say how it went"
                } else {
                    "the lease has no such group"
                };
                return Ok(Err(("unknown_episode", why.to_owned())));
            };
            let stage = self.stage(conn, &row, lease.is_columns()).await?;
            self.stages.insert((lease.id, group), stage);
        }
        Ok(Ok((lease.id, id.index, group)))
    }

    async fn lease(
        &mut self,
        conn: &mut SqliteConnection,
        id: &LeaseId,
    ) -> Result<Result<LeaseRow, (&'static str, String)>, TrainingError> {
        if let Some(known) = self.leases.get(id) {
            return Ok(known.clone());
        }
        let found = match leases::get(conn, id.number).await?.filter(|row| row.token == id.token) {
            None => Err(("unknown_episode", format!("there is no lease {id}"))),
            Some(row) if row.run != self.run.as_str() => {
                Err(("foreign_episode", format!("lease {id} is not one of run {}", self.run)))
            }
            Some(row) => Ok(row),
        };
        self.leases.insert(id.clone(), found.clone());
        Ok(found)
    }

    async fn stage(
        &mut self,
        conn: &mut SqliteConnection,
        group: &GroupRow,
        may_be_bare: bool,
    ) -> Result<Stage, TrainingError> {
        let scenario = self.loader.get(conn, &group.scenario).await?;
        let bracket = brackets::newest(conn, &group.scenario).await?;
        if bracket.is_none() && !may_be_bare {
            return Err(
                store::StoreError::unreadable("a bracket", "there is none for a leased scenario").into()
            );
        }
        Ok(Stage { scenario, bracket })
    }
}

fn judge(claim: Claim, place: Place, stages: &HashMap<(i64, i64), Stage>, settings: &RunSettings) -> Audited {
    let Claim { episode, what, policy_version, metrics } = claim;
    let (place, verdict) = match place {
        Err((code, detail)) => (None, Verdict::Refused { code, detail }),
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
        log: log.encode(),
        flown,
    }
}
