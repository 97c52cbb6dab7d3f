//! Outcomes of designed groups: they update the layout, and are no evidence of mastery.

use env_core::bracket::MIN_GAP;
use store::episodes::{self, FinishedEpisode};
use store::groups::GroupRow;
use store::keys::EpisodeSpan;
use store::layout_outcomes::{self, LayoutOutcome};
use store::layout_transitions;
use store::layouts::{self, LayoutKind, LayoutRow};
use store::leases::LeaseRow;
use store::{StoreError, from_json, to_json};

use crate::designs::layout_status::{LayoutHistory, LayoutStatus, RecentResult};
use crate::engine::error::ServiceError;
use crate::engine::run_tx::RunTx;
use crate::runs::settings::RunSettings;

/// Counts a closed designed group. A group with too few finished episodes, or with results of too old a policy, does not count for
/// its layout; it is not offered again.
pub(crate) async fn observe_designed_group(
    run: &mut RunTx<'_>,
    lease: &LeaseRow,
    group: &GroupRow,
    is_enough: bool,
) -> Result<(), ServiceError> {
    let from = group.number * lease.group_size;
    let span = EpisodeSpan { lease: lease.id, from, to: from + lease.group_size };
    let finished = episodes::finished(run.conn, span).await?;
    let is_stale = is_outdated(&run.state.settings, run.state.policy_version, &finished);
    if !is_enough || is_stale {
        return Ok(());
    }
    if let Some(id) = group.layout
        && let Some(row) = layouts::get(run.conn, id).await?
    {
        update_layout(run, row, &finished).await?;
    }
    Ok(())
}

/// Returns true if the oldest policy version among the episodes is too old to count.
fn is_outdated(settings: &RunSettings, newest: i64, episodes: &[FinishedEpisode]) -> bool {
    let oldest = episodes.iter().map(|f| f.policy_version).min();
    settings.max_staleness.zip(oldest).is_some_and(|(most, oldest)| newest - oldest > i64::from(most))
}

/// Returns the regret of an episode: (reference − score)/(reference − floor) clamped to [0, 1], which is 1 − skill. On a decoy, and
/// where no skill is defined, it is (reference − score)/reference.
fn regret(episode: &FinishedEpisode, is_decoy: bool) -> f64 {
    let share = || (episode.reference - episode.score) / episode.reference.abs().max(MIN_GAP);
    let missed = episode.skill.filter(|_| !is_decoy).map_or_else(share, |skill| 1.0 - skill);
    missed.clamp(0.0, 1.0)
}

/// Returns true if an episode achieved what its layout demands. On a decoy doing nothing loses no satellite, so the score must also
/// be within the minimum gap of the reference: hardly anything was wasted.
fn is_mastered(episode: &FinishedEpisode, is_decoy: bool) -> bool {
    episode.success && (!is_decoy || episode.reference - episode.score < MIN_GAP)
}

/// Adds the outcome of a group to its layout, which may change its status.
async fn update_layout(
    run: &mut RunTx<'_>,
    row: LayoutRow,
    episodes: &[FinishedEpisode],
) -> Result<(), StoreError> {
    let Some(status) = LayoutStatus::from_stored(row.state, row.retirement_reason) else { return Ok(()) };
    let mut history = LayoutHistory { status, recent: from_json("a layout's results", &row.recent_results)? };
    let is_decoy = row.kind == Some(LayoutKind::Decoy);
    let successes = episodes.iter().filter(|episode| is_mastered(episode, is_decoy)).count();
    let result = RecentResult {
        successes: successes as f64,
        episodes: u32::try_from(episodes.len()).unwrap_or(u32::MAX),
    };
    let reason = history.observe(result);
    let outcome = LayoutOutcome {
        episodes: episodes.len() as i64,
        successes: successes as i64,
        score_sum: episodes.iter().map(|episode| episode.score).sum(),
        regret_sum: episodes.iter().map(|episode| regret(episode, is_decoy)).sum(),
        recent_results: to_json(&history.recent)?,
    };
    layout_outcomes::add_outcome(run.conn, row.id, &outcome).await?;
    if let Some(reason) = reason {
        layout_transitions::change_state(run.conn, row.id, &history.status.transition(reason), run.now)
            .await?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn episode(score: f64, skill: Option<f64>) -> FinishedEpisode {
        FinishedEpisode { success: true, skill, score, reference: 0.9, policy_version: 0, steps: 1 }
    }

    #[test]
    fn waste_on_a_decoy_is_no_mastery() {
        assert!(is_mastered(&episode(0.89, None), true) && !is_mastered(&episode(0.7, None), true));
        assert!(is_mastered(&episode(0.7, Some(0.8)), false));
        assert!(!is_mastered(&FinishedEpisode { success: false, ..episode(0.9, None) }, true));
        assert_eq!((regret(&episode(0.45, None), true), regret(&episode(0.9, None), true)), (0.5, 0.0));
        assert!((regret(&episode(0.7, Some(0.8)), false) - 0.2).abs() < 1e-12);
        assert_eq!(regret(&episode(0.45, Some(-1.0)), true), 0.5);
    }
}
