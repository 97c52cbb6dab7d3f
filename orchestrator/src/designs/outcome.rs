//! How a designed group went: what it says of its layout, and, where the run wants that, of the agent.

use env_core::bracket::MIN_GAP;
use serde_json::Value;

use crate::designs::layout_life::{LayoutLife, LayoutStatus};
use crate::designs::serve::at_frontier;
use crate::engine::run_tx::RunTx;
use crate::results::observe::observe;
use crate::engine::error::ServiceError;
use crate::runs::settings::RunSettings;
use crate::store::episodes::{self, FinishedEpisode};
use crate::store::groups::GroupRow;
use crate::store::keys::EpisodeSpan;
use crate::store::layout_outcomes::{self, LayoutOutcome};
use crate::store::layout_transitions::{self, LayoutTransition};
use crate::store::layouts::{self, LayoutClaim, LayoutRow};
use crate::store::leases::LeaseRow;
use crate::store::{StoreError, from_json, to_json, to_u32};
use curriculum::{GroupOutcome, LevelMove, ProposalRole, LearningSignals, ScenarioSource};

/// Takes a designed group that is closed. What too few episodes came back of, or too old a policy flew, says nothing of its
/// layout; it is not offered again.
pub(crate) async fn take(
    run: &mut RunTx<'_>,
    lease: &LeaseRow,
    group: &GroupRow,
    enough: bool,
    expired: i64,
) -> Result<Vec<LevelMove>, ServiceError> {
    let from = group.number * lease.group_size;
    let span = EpisodeSpan { lease: lease.id, from, to: from + lease.group_size };
    let fared = episodes::finished(run.conn, span).await?;
    let stale = is_stale(&run.state.settings, run.state.policy_version, &fared);
    let mut fresh = false;
    if enough && !stale {
        let row = match group.layout {
            Some(id) => layouts::get(run.conn, id).await?,
            None => None,
        };
        if let Some(row) = row {
            fresh = row.outcomes == 0 && at_its_level(&run.state.settings, &row)?;
            enter(run.conn, row, &fared, run.now).await?;
        }
    }
    if !group.is_evidence || !fresh || !at_frontier(run.state, &group.task, group.level) {
        return Ok(Vec::new());
    }
    if !stale && group.is_contested && group.finished > 0 {
        let part = run.task_counts(&group.task);
        part.contested += 1;
        part.solved += group.successes as f64 / group.finished as f64;
    }
    let epoch = run.state.curriculum.status().into_iter().find(|s| s.task == group.task).map_or(0, |s| s.epoch);
    let outcome = GroupOutcome {
        // It has no proposal: it is named by its own place.
        proposal: run.state.curriculum.next_seq(),
        task: group.task.clone(),
        level: group.level.map(to_u32),
        epoch,
        role: ProposalRole::Frontier,
        contested: group.is_contested,
        finished: if enough { to_u32(group.finished) } else { 0 },
        successes: if enough { to_u32(group.successes) } else { 0 },
        failed: to_u32(group.failed),
        expired: to_u32(expired),
        evidence: !stale,
        mean_score: mean(fared.iter().map(|f| f.score)).unwrap_or(0.0),
        mean_skill: mean(fared.iter().filter_map(|f| f.skill)),
        source: ScenarioSource::Fresh,
        params: Vec::new(),
        signals: LearningSignals::default(),
    };
    observe(run, outcome).await
}

/// Whether a layout has the params of the level it was designed at: a design may choose others near it.
fn at_its_level(settings: &RunSettings, row: &LayoutRow) -> Result<bool, StoreError> {
    let Some(plan) = settings.curriculum.task(&row.task) else { return Ok(false) };
    let params = plan.params(row.level.map(to_u32));
    let Some(text) = &row.design else { return Ok(false) };
    let design: Value = from_json("a design", text)?;
    let same = |(name, value): (&String, &Value)| {
        params.iter().any(|(known, held)| known == name && value.as_f64() == Some(*held))
    };
    Ok(design.get("params").and_then(Value::as_object).is_none_or(|chosen| chosen.iter().all(same)))
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0u32), |(sum, n), value| (sum + value, n + 1));
    (n > 0).then(|| sum / f64::from(n))
}

fn is_stale(settings: &RunSettings, newest: i64, fared: &[FinishedEpisode]) -> bool {
    let oldest = fared.iter().map(|f| f.policy_version).min();
    settings.max_staleness.zip(oldest).is_some_and(|(most, oldest)| newest - oldest > i64::from(most))
}

/// What an episode left on the table: (reference − score)/(reference − floor) within [0, 1], which is 1 − skill; on a decoy,
/// and where no skill is defined, (reference − score)/reference.
fn regret(fared: &FinishedEpisode, decoy: bool) -> f64 {
    let share = || (fared.reference - fared.score) / fared.reference.abs().max(MIN_GAP);
    let missed = fared.skill.filter(|_| !decoy).map_or_else(share, |skill| 1.0 - skill);
    missed.clamp(0.0, 1.0)
}

/// Whether an episode did what its layout asks for. On a decoy nobody is lost who does nothing: there it is asked that
/// hardly anything was wasted, less than would make a skill defined.
fn mastered(fared: &FinishedEpisode, decoy: bool) -> bool {
    fared.success && (!decoy || fared.reference - fared.score < MIN_GAP)
}

async fn enter(
    conn: &mut sqlx::SqliteConnection,
    row: LayoutRow,
    fared: &[FinishedEpisode],
    now: i64,
) -> Result<(), StoreError> {
    let Some(standing) = LayoutStatus::of(row.state, row.why) else { return Ok(()) };
    let recent = from_json("a layout's outcomes", &row.recent)?;
    let mut life = LayoutLife { standing, recent, barren: to_u32(row.barren) };
    let decoy = row.claim == Some(LayoutClaim::Decoy);
    let successes = fared.iter().filter(|f| mastered(f, decoy)).count();
    let told = life.take(successes as f64 / fared.len().max(1) as f64);
    let flown = LayoutOutcome {
        episodes: fared.len() as i64,
        successes: successes as i64,
        score: fared.iter().map(|f| f.score).sum(),
        regret: fared.iter().map(|fared| regret(fared, decoy)).sum(),
        recent: to_json(&life.recent)?,
        barren: i64::from(life.barren),
    };
    layout_outcomes::add_outcome(conn, row.id, &flown).await?;
    if let Some(reason) = told {
        let (state, why) = life.standing.words();
        layout_transitions::change_state(conn, row.id, &LayoutTransition { state, why, reason }, now).await?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fared(score: f64, skill: Option<f64>) -> FinishedEpisode {
        FinishedEpisode { success: true, skill, score, reference: 0.9, policy_version: 0 }
    }

    #[test]
    fn waste_on_a_decoy_is_no_success_though_nobody_is_lost() {
        assert!(mastered(&fared(0.89, None), true) && !mastered(&fared(0.7, None), true));
        assert!(mastered(&fared(0.7, Some(0.8)), false));
        assert!(!mastered(&FinishedEpisode { success: false, ..fared(0.9, None) }, true));
        assert_eq!((regret(&fared(0.45, None), true), regret(&fared(0.9, None), true)), (0.5, 0.0));
        assert!((regret(&fared(0.7, Some(0.8)), false) - 0.2).abs() < 1e-12);
        assert_eq!(regret(&fared(0.45, Some(-1.0)), true), 0.5);
    }
}
