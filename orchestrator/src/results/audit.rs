//! Replays reported episodes: score, skill and success come from the actions, never from the client.

use std::collections::HashMap;
use std::sync::Arc;

use api_types::RefusalCode;
use env_core::admission::{admit, is_success};
use env_core::error::ReplayError;
use env_core::rollout::{ReplayItem, read_log, replay_all};
use env_core::{ActionLog, Bracket, EpisodeOutcome, Scenario};
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

/// Largest number of episodes that a thread replays together.
const REPLAYED_TOGETHER: usize = 32;

/// Looks every reported episode up, and replays them in parallel on `threads`.
///
/// # Errors
/// Returns an error of the store, or [`ServiceError::Invalid`] if a replay panics. An episode that is wrong is refused by itself.
pub async fn audit(
    conn: &mut SqliteConnection,
    threads: &Arc<ThreadPool>,
    run: &RunId,
    actor: Actor,
    settings: RunSettings,
    reported: Vec<ReportedEpisode>,
) -> Result<AuditedReport, ServiceError> {
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
    let threads = Arc::clone(threads);
    let audited = tokio::task::spawn_blocking(move || {
        threads.install(|| {
            let brackets = compute_brackets(&mut targets);
            let together = reported.len().div_ceil(rayon::current_num_threads()).clamp(1, REPLAYED_TOGETHER);
            let episodes: Vec<_> = reported.into_iter().zip(lookups).collect();
            let episodes = episodes
                .into_par_iter()
                .chunks(together)
                .flat_map_iter(|chunk| audit_episodes(chunk, &targets, &settings))
                .collect();
            AuditedReport { episodes, brackets }
        })
    });
    audited.await.map_err(|error| ServiceError::invalid("results", error.to_string()))
}

/// Computes the brackets that are missing.
fn compute_brackets(targets: &mut HashMap<GroupKey, ReplayTarget>) -> Vec<DeferredBracket> {
    let missing: Vec<_> = targets.iter_mut().filter(|(_, target)| target.bracket.is_none()).collect();
    let computed = missing.into_par_iter().filter_map(|(group, target)| {
        let admission = admit(&target.scenario);
        let bracket = admission.bracket?;
        target.bracket = Some(bracket.clone());
        let (group, scenario) = (*group, target.scenario.clone());
        Some(DeferredBracket { group, scenario, bracket, is_contested: admission.contested })
    });
    computed.collect()
}

/// A reported episode whose log was read.
struct ReadEpisode<'a> {
    episode: String,
    key: Option<EpisodeKey>,
    policy_version: Option<u32>,
    metrics: Option<String>,
    /// The log to be replayed; the outcome of the audit if there is none.
    replay: Result<PendingReplay<'a>, Box<AuditOutcome>>,
}

/// A log that is replayed on its scenario.
struct PendingReplay<'a> {
    scenario: &'a Scenario,
    bracket: &'a Bracket,
    log: ActionLog,
}

/// Audits reported episodes, whose logs are replayed together.
fn audit_episodes(
    chunk: Vec<(ReportedEpisode, EpisodeLookup)>,
    targets: &HashMap<GroupKey, ReplayTarget>,
    settings: &RunSettings,
) -> Vec<AuditedEpisode> {
    let read: Vec<ReadEpisode<'_>> =
        chunk.into_iter().map(|(episode, lookup)| read_episode(episode, lookup, targets)).collect();
    let pending = read.iter().filter_map(|episode| episode.replay.as_ref().ok());
    let items: Vec<_> =
        pending.map(|replay| ReplayItem { scenario: replay.scenario, log: &replay.log }).collect();
    // One outcome for each pending replay, in their order.
    let mut outcomes = replay_all(&items).into_iter();
    let audited = read.into_iter().filter_map(|read| {
        let ReadEpisode { episode, key, policy_version, metrics, replay } = read;
        let outcome = match replay {
            Ok(replay) => replay.outcome(outcomes.next()?, settings),
            Err(outcome) => *outcome,
        };
        Some(AuditedEpisode { episode, key, policy_version, metrics, is_in_session: false, outcome })
    });
    audited.collect()
}

/// Reads the log of a reported episode.
fn read_episode(
    reported: ReportedEpisode,
    lookup: EpisodeLookup,
    targets: &HashMap<GroupKey, ReplayTarget>,
) -> ReadEpisode<'_> {
    let ReportedEpisode { episode, outcome, policy_version, metrics } = reported;
    let (key, replay) = match lookup {
        Err(outcome) => (None, Err(Box::new(outcome))),
        Ok(place) => (Some(place.episode), read_log_of(outcome, targets.get(&place.group))),
    };
    ReadEpisode { episode, key, policy_version, metrics, replay }
}

/// The log of an outcome; the audit's outcome if there is nothing to replay.
fn read_log_of(
    outcome: ReportedOutcome,
    target: Option<&ReplayTarget>,
) -> Result<PendingReplay<'_>, Box<AuditOutcome>> {
    let find = || match target {
        Some(ReplayTarget { scenario, bracket: Some(bracket) }) => Ok((scenario, bracket)),
        Some(_) => Err(refused(RefusalCode::InvalidLog, "its scenario has no fair start")),
        None => Err(refused(RefusalCode::UnknownEpisode, "its scenario was deleted")),
    };
    match outcome {
        ReportedOutcome::Failed { reason } => Err(Box::new(AuditOutcome::Failed(reason))),
        ReportedOutcome::Refused(refusal) => Err(Box::new(AuditOutcome::Refused(refusal))),
        ReportedOutcome::Finished { steps, precision, stopped } => {
            let (scenario, bracket) = find()?;
            let log = read_log(scenario, &steps, precision, stopped);
            let log = log.map_err(|error| Box::new(invalid_log(error.into())))?;
            Ok(PendingReplay { scenario, bracket, log })
        }
        ReportedOutcome::Logged(log) => {
            let (scenario, bracket) = find()?;
            Ok(PendingReplay { scenario, bracket, log })
        }
    }
}

fn refused(code: RefusalCode, detail: &str) -> Box<AuditOutcome> {
    Box::new(AuditOutcome::refused(code, detail))
}

fn invalid_log(error: ReplayError) -> AuditOutcome {
    let detail = match error {
        ReplayError::Log(error) => error.with_parent("actions").to_string(),
        ReplayError::Scenario(error) => error.to_string(),
        ReplayError::Policy(error) => error.to_string(),
    };
    AuditOutcome::refused(RefusalCode::InvalidLog, detail)
}

impl PendingReplay<'_> {
    /// The audit's outcome of a replay.
    fn outcome(self, replayed: Result<EpisodeOutcome, ReplayError>, settings: &RunSettings) -> AuditOutcome {
        let Self { scenario, bracket, log } = self;
        let outcome = match replayed {
            Ok(outcome) => outcome,
            Err(error) => return invalid_log(error),
        };
        let rule = settings.rule(scenario.task().id());
        AuditOutcome::Replayed(ReplayedEpisode {
            skill: bracket.skill(outcome.score),
            is_success: is_success(scenario, rule, bracket, &outcome),
            floor: bracket.floor,
            reference: bracket.reference.score,
            planner: bracket.planner_version,
            log: StoredLog::of(&log),
            outcome,
        })
    }
}
