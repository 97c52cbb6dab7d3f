//! Replays reported episodes: score, skill and success come from the actions, never from the client.

use std::collections::HashMap;
use std::sync::Arc;

use api_types::RefusalCode;
use env_core::ActionLog;
use env_core::admission::{admit, is_success};
use env_core::error::ReplayError;
use env_core::rollout::{read_log, replay};
use rayon::ThreadPool;
use rayon::prelude::*;
use sqlx::SqliteConnection;
use store::StoreError;
use store::episodes::StoredLog;
use store::ids::RunId;
use store::keys::GroupKey;

use crate::engine::error::ServiceError;
use crate::ownership::Actor;
use crate::results::audit_outcome::{
    AuditOutcome, AuditedEpisode, AuditedReport, DeferredBracket, ReplayedEpisode,
};
use crate::results::episode_lookup::{EpisodeFinder, EpisodeLookup, ReplayTarget};
use crate::results::reported::{ReportedEpisode, ReportedOutcome};
use crate::runs::settings::RunSettings;

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
            let episodes = reported.into_par_iter().zip(lookups);
            let episodes = episodes
                .map(|(episode, lookup)| audit_episode(episode, lookup, &targets, &settings))
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

fn audit_episode(
    reported: ReportedEpisode,
    lookup: EpisodeLookup,
    targets: &HashMap<GroupKey, ReplayTarget>,
    settings: &RunSettings,
) -> AuditedEpisode {
    let ReportedEpisode { episode, outcome, policy_version, metrics } = reported;
    let (key, outcome) = match lookup {
        Err(outcome) => (None, outcome),
        Ok(place) => {
            let outcome = match (outcome, targets.get(&place.group)) {
                (ReportedOutcome::Failed { reason }, _) => AuditOutcome::Failed(reason),
                (ReportedOutcome::Refused(refusal), _) => AuditOutcome::Refused(refusal),
                (ReportedOutcome::Finished { steps, precision, stopped }, Some(target)) => {
                    match read_log(&target.scenario, &steps, precision, stopped) {
                        Ok(log) => replay_log(target, settings, &log),
                        Err(error) => invalid_log(error.into()),
                    }
                }
                (ReportedOutcome::Logged(log), Some(target)) => replay_log(target, settings, &log),
                (ReportedOutcome::Finished { .. } | ReportedOutcome::Logged(_), None) => {
                    AuditOutcome::refused(RefusalCode::UnknownEpisode, "its scenario was deleted")
                }
            };
            (Some(place.episode), outcome)
        }
    };
    AuditedEpisode { episode, key, policy_version, metrics, is_in_session: false, outcome }
}

fn invalid_log(error: ReplayError) -> AuditOutcome {
    let detail = match error {
        ReplayError::Log(error) => error.with_parent("actions").to_string(),
        ReplayError::Scenario(error) => error.to_string(),
        ReplayError::Policy(error) => error.to_string(),
    };
    AuditOutcome::refused(RefusalCode::InvalidLog, detail)
}

fn replay_log(target: &ReplayTarget, settings: &RunSettings, log: &ActionLog) -> AuditOutcome {
    let ReplayTarget { scenario, bracket: Some(bracket) } = target else {
        return AuditOutcome::refused(RefusalCode::InvalidLog, "its scenario has no fair start");
    };
    let outcome = match replay(scenario, log) {
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
        log: StoredLog::of(log),
        outcome,
    })
}
