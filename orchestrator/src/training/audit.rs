//! Replaying what trainers report: score, skill and success come from the actions, never from the client.

use std::collections::HashMap;

use env_core::bracket::{Bracket, Flown, success};
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

/// A group with what is needed to replay its episodes.
struct Stage {
    scenario: Scenario,
    bracket: Bracket,
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
) -> Result<Vec<Audited>, TrainingError> {
    let mut finder = Finder::new(run);
    let mut places = Vec::with_capacity(claims.len());
    for claim in &claims {
        places.push(finder.place(conn, &claim.episode).await?);
    }
    let stages = finder.stages;
    let audited = tokio::task::spawn_blocking(move || {
        claims
            .into_par_iter()
            .zip(places)
            .map(|(claim, place)| judge(claim, place, &stages, &settings))
            .collect()
    });
    audited.await.map_err(|error| TrainingError::invalid("results", error.to_string()))
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
                return Ok(Err(("unknown_episode", "the lease has no such group".to_owned())));
            };
            let stage = self.stage(conn, &row).await?;
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

    async fn stage(&mut self, conn: &mut SqliteConnection, group: &GroupRow) -> Result<Stage, TrainingError> {
        let scenario = self.loader.get(conn, &group.scenario).await?;
        let bracket = brackets::newest(conn, &group.scenario).await?.ok_or_else(|| {
            store::StoreError::unreadable("a bracket", "there is none for a leased scenario")
        })?;
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
                (Claimed::Logged(log), Some(stage)) => {
                    judge_log(&stage.scenario, &stage.bracket, settings, &log).unwrap_or_else(invalid)
                }
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
    let Stage { scenario, bracket } = stage;
    let log = match read_log(scenario, steps, precision, stopped) {
        Ok(log) => log,
        Err(error) => return invalid(error.into()),
    };
    judge_log(scenario, bracket, settings, &log).unwrap_or_else(invalid)
}

fn invalid(error: ReplayError) -> Verdict {
    let detail = match error {
        ReplayError::Log(error) => error.under("actions").to_string(),
        ReplayError::Scenario(error) => error.to_string(),
    };
    Verdict::Refused { code: "invalid_log", detail }
}

fn judge_log(
    scenario: &Scenario,
    bracket: &Bracket,
    settings: &RunSettings,
    log: &ActionLog,
) -> Result<Verdict, ReplayError> {
    let flown = replay(scenario, log)?;
    let rule = settings.rule(scenario.task().id());
    Ok(Verdict::Flown {
        skill: bracket.skill(flown.score),
        success: success(scenario, rule, bracket, &flown),
        floor: bracket.floor,
        reference: bracket.reference.score,
        planner: bracket.planner,
        log: log.encode(),
        flown,
    })
}
