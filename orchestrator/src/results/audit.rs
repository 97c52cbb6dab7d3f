//! Audits reported episodes: score, skill and success come from a replay of the actions, never from the client.
//!
//! The replay is a job of the [`JobQueue`]; reading logs and judging outcomes stay here.

use std::collections::HashMap;
use std::sync::Arc;

use api_types::RefusalCode;
use env_core::admission::is_success;
use env_core::rollout::read_log;
use env_core::{ActionLog, Scenario};
use job_queue::{CompletedJob, JobError, JobQueue, Receipt};
use jobs::audit::{AuditOutput, AuditPayload, ComputedBracket, ReplayOutcome, describe};
use jobs::{EpisodeBatch, JobOutput, JobPayload, LoggedEpisode};
use rayon::ThreadPool;
use rayon::prelude::*;
use sqlx::SqliteConnection;
use store::StoreError;
use store::episodes::StoredLog;
use store::ids::RunId;
use store::keys::{EpisodeKey, GroupKey};

use crate::engine::error::ServiceError;
use crate::ownership::Actor;
use crate::results::audit_outcome::{
    AuditOutcome, AuditedEpisode, AuditedReport, DeferredBracket, ReplayedEpisode,
};
use crate::results::episode_lookup::{EpisodeFinder, EpisodeLookup, ReplayTarget};
use crate::results::reported::{ReportedEpisode, ReportedOutcome};
use crate::runs::settings::RunSettings;
use crate::threads;

/// Computation of audits: threads for logs and outcomes, and a queue for replays.
#[derive(Debug, Clone)]
pub struct AuditEngine {
    /// Threads that read logs and judge outcomes, at a lower priority than those that answer and write.
    pub threads: Arc<ThreadPool>,
    /// Queue that replays logs.
    pub queue: Arc<dyn JobQueue>,
}

/// Audited report, with the acknowledgement that is due after its commit.
#[derive(Debug)]
pub struct CompletedAudit {
    /// Audited episodes and computed brackets.
    pub report: AuditedReport,
    /// What to acknowledge after the commit.
    pub receipt: Receipt,
}

/// Groups of a report, with what their episodes are replayed on.
type ReplayTargets = HashMap<GroupKey, ReplayTarget>;

/// Looks every reported episode up, and replays them.
///
/// # Errors
/// Returns an error of the store, or [`ServiceError::Invalid`] if a replay panics. An episode that is wrong is refused by itself.
pub async fn audit(
    conn: &mut SqliteConnection,
    engine: &AuditEngine,
    run: &RunId,
    actor: Actor,
    settings: RunSettings,
    reported: Vec<ReportedEpisode>,
) -> Result<CompletedAudit, ServiceError> {
    let mut finder = EpisodeFinder::new(run, actor);
    let mut lookups = Vec::with_capacity(reported.len());
    // One read transaction: if a lease were compacted between `find` and `load`, its groups would no longer exist.
    let mut snapshot = sqlx::Connection::begin(conn).await.map_err(StoreError::from)?;
    for episode in &reported {
        lookups.push(finder.find(&mut snapshot, &episode.episode).await?);
    }
    finder.load(&mut snapshot).await?;
    snapshot.rollback().await.map_err(StoreError::from)?; // nothing was written
    for lookup in &mut lookups {
        finder.confirm(lookup);
    }
    let mut targets = finder.into_targets();
    let mut receipt = Receipt::default();
    let brackets = engine.compute_brackets(&mut targets, &mut receipt).await?;
    let targets = Arc::new(targets);
    let (known, episodes) = (Arc::clone(&targets), reported.into_iter().zip(lookups).collect::<Vec<_>>());
    let read = threads::run_on(&engine.threads, move || -> Vec<ReadEpisode> {
        episodes.into_par_iter().map(|(episode, lookup)| read_episode(episode, lookup, &known)).collect()
    });
    let read = read.await.ok_or_else(panicked)?;
    let replayed = engine.replay(&read, &targets, &mut receipt).await?;
    let audited = threads::run_on(&engine.threads, move || {
        let pairs: Vec<_> = pair_outcomes(read, replayed);
        pairs
            .into_par_iter()
            .filter_map(|(read, replayed)| read.finish(replayed, &targets, &settings))
            .collect()
    });
    let report = AuditedReport { episodes: audited.await.ok_or_else(panicked)?, brackets };
    Ok(CompletedAudit { report, receipt })
}

fn panicked() -> ServiceError {
    failed(JobError::Panicked)
}

fn failed(error: JobError) -> ServiceError {
    ServiceError::invalid("results", error.to_string())
}

impl AuditEngine {
    /// Computes the brackets that are missing.
    async fn compute_brackets(
        &self,
        targets: &mut ReplayTargets,
        receipt: &mut Receipt,
    ) -> Result<Vec<DeferredBracket>, ServiceError> {
        let mut missing: Vec<GroupKey> =
            targets.iter().filter(|(_, target)| target.bracket.is_none()).map(|(group, _)| *group).collect();
        if missing.is_empty() {
            return Ok(Vec::new());
        }
        missing.sort_unstable();
        let scenarios =
            missing.iter().filter_map(|group| Some(targets.get(group)?.scenario.clone())).collect();
        let AuditOutput::Brackets(computed) = self.run(AuditPayload::Brackets(scenarios), receipt).await?
        else {
            return Err(failed(JobError::OtherKind));
        };
        let mut brackets = Vec::with_capacity(computed.len());
        for (group, computed) in missing.into_iter().zip(computed) {
            let (Some(ComputedBracket { bracket, is_contested }), Some(target)) =
                (computed, targets.get_mut(&group))
            else {
                continue;
            };
            target.bracket = Some(bracket.clone());
            brackets.push(DeferredBracket {
                group,
                scenario: target.scenario.clone(),
                bracket,
                is_contested,
            });
        }
        Ok(brackets)
    }

    /// Replays the logs that were read. Returns one outcome for each, in their order.
    async fn replay(
        &self,
        read: &[ReadEpisode],
        targets: &ReplayTargets,
        receipt: &mut Receipt,
    ) -> Result<Vec<ReplayOutcome>, ServiceError> {
        let pending = read.iter().filter_map(|episode| episode.replay.as_ref().ok());
        let episodes: Vec<LoggedEpisode> = pending.filter_map(|replay| replay.episode(targets)).collect();
        if episodes.is_empty() {
            return Ok(Vec::new());
        }
        match self.run(AuditPayload::Replays(EpisodeBatch(episodes)), receipt).await? {
            AuditOutput::Replays(outcomes) => Ok(outcomes),
            AuditOutput::Brackets(_) => Err(failed(JobError::OtherKind)),
        }
    }

    async fn run(&self, payload: AuditPayload, receipt: &mut Receipt) -> Result<AuditOutput, ServiceError> {
        let done = self.queue.run(JobPayload::Audit(payload)).await.map_err(failed)?;
        let CompletedJob { output: JobOutput::Audit(output), receipt: due } = done else {
            return Err(failed(JobError::OtherKind));
        };
        receipt.merge(due);
        Ok(output)
    }
}

/// A reported episode whose log was read.
struct ReadEpisode {
    episode: String,
    key: Option<EpisodeKey>,
    policy_version: Option<u32>,
    metrics: Option<String>,
    /// The log to be replayed; the outcome of the audit if there is none.
    replay: Result<PendingReplay, Box<AuditOutcome>>,
}

/// A log that is replayed on the scenario of its group, which has a bracket.
struct PendingReplay {
    group: GroupKey,
    log: Arc<ActionLog>,
}

/// Pairs episodes with the outcomes of those that are replayed.
fn pair_outcomes(
    read: Vec<ReadEpisode>,
    replayed: Vec<ReplayOutcome>,
) -> Vec<(ReadEpisode, Option<ReplayOutcome>)> {
    let mut replayed = replayed.into_iter();
    let pair = |read: ReadEpisode| {
        let outcome = if read.replay.is_ok() { replayed.next() } else { None };
        (read, outcome)
    };
    read.into_iter().map(pair).collect()
}

/// Reads the log of a reported episode.
fn read_episode(reported: ReportedEpisode, lookup: EpisodeLookup, targets: &ReplayTargets) -> ReadEpisode {
    let ReportedEpisode { episode, outcome, policy_version, metrics } = reported;
    let (key, replay) = match lookup {
        Err(outcome) => (None, Err(Box::new(outcome))),
        Ok(place) => {
            let log = read_log_of(outcome, targets.get(&place.group));
            (Some(place.episode), log.map(|log| PendingReplay { group: place.group, log: Arc::new(log) }))
        }
    };
    ReadEpisode { episode, key, policy_version, metrics, replay }
}

/// The log of an outcome; the audit's outcome if there is nothing to replay.
fn read_log_of(
    outcome: ReportedOutcome,
    target: Option<&ReplayTarget>,
) -> Result<ActionLog, Box<AuditOutcome>> {
    match outcome {
        ReportedOutcome::Failed { reason } => Err(Box::new(AuditOutcome::Failed(reason))),
        ReportedOutcome::Refused(refusal) => Err(Box::new(AuditOutcome::Refused(refusal))),
        ReportedOutcome::Finished { steps, precision, stopped } => {
            let log = read_log(scenario_of(target)?, &steps, precision, stopped);
            log.map_err(|error| refused(RefusalCode::InvalidLog, &describe(error.into())))
        }
        ReportedOutcome::Logged(log) => scenario_of(target).map(|_| log),
    }
}

/// The scenario that the episodes of a group are replayed on.
fn scenario_of(target: Option<&ReplayTarget>) -> Result<&Scenario, Box<AuditOutcome>> {
    match target {
        Some(ReplayTarget { scenario, bracket: Some(_) }) => Ok(scenario),
        Some(_) => Err(refused(RefusalCode::InvalidLog, "its scenario has no fair start")),
        None => Err(refused(RefusalCode::UnknownEpisode, "its scenario was deleted")),
    }
}

fn refused(code: RefusalCode, detail: &str) -> Box<AuditOutcome> {
    Box::new(AuditOutcome::refused(code, detail))
}

impl ReadEpisode {
    /// The audited episode; `None` if its replay is missing.
    fn finish(
        self,
        replayed: Option<ReplayOutcome>,
        targets: &ReplayTargets,
        settings: &RunSettings,
    ) -> Option<AuditedEpisode> {
        let Self { episode, key, policy_version, metrics, replay } = self;
        let outcome = match replay {
            Ok(replay) => replay.outcome(replayed?, targets, settings)?,
            Err(outcome) => *outcome,
        };
        Some(AuditedEpisode { episode, key, policy_version, metrics, is_in_session: false, outcome })
    }
}

impl PendingReplay {
    /// The episode for the queue.
    fn episode(&self, targets: &ReplayTargets) -> Option<LoggedEpisode> {
        let scenario = targets.get(&self.group)?.scenario.clone();
        Some(LoggedEpisode { scenario, log: Arc::clone(&self.log) })
    }

    /// The audit's outcome of a replay.
    fn outcome(
        self,
        replayed: ReplayOutcome,
        targets: &ReplayTargets,
        settings: &RunSettings,
    ) -> Option<AuditOutcome> {
        let outcome = match replayed {
            Ok(outcome) => outcome,
            Err(detail) => return Some(AuditOutcome::refused(RefusalCode::InvalidLog, detail)),
        };
        let ReplayTarget { scenario, bracket: Some(bracket) } = targets.get(&self.group)? else {
            return None;
        };
        let rule = settings.rule(scenario.task().id());
        Some(AuditOutcome::Replayed(ReplayedEpisode {
            skill: bracket.skill(outcome.score),
            is_success: is_success(scenario, rule, bracket, &outcome),
            floor: bracket.floor,
            reference: bracket.reference.score,
            planner: bracket.planner_version,
            log: StoredLog::of(&self.log),
            outcome,
        }))
    }
}
