//! Loads the brief of a designer from the store.

use std::time::Duration;

use designer::brief::{DesignBrief, DesignRung, LayoutOutcome, PastLayout};
use env_core::Seed;
use serde_json::Value;
use sqlx::SqliteConnection;
use store::layouts::{self, LayoutFilter, LayoutRow, LayoutState};
use store::{StoreError, from_json, scenarios, to_u32};

use crate::designs::start_design::StartedDesignRequest;

/// Maximum number of earlier admitted layouts in a brief. Refused ones have a limit of their own, so that a bad round does not
/// displace what worked.
const MAX_ADMITTED: i64 = 24;
/// Maximum number of earlier refused layouts in a brief.
const MAX_REFUSED: i64 = 8;
/// Time after which a designer returns what it has.
const TIME_LIMIT: Duration = Duration::from_secs(540);
/// Maximum number of earlier designs that a new one is compared with.
const MAX_ARCHIVE: i64 = 500;

/// A brief, and the earlier designs that the gate compares new ones with.
#[derive(Debug, Clone)]
pub struct BriefWithArchive {
    /// Brief of the designer.
    pub brief: DesignBrief,
    /// Earlier designs of the run's task.
    pub archive: Vec<Value>,
}

/// Loads the brief of a request that was started.
///
/// # Errors
/// Returns [`StoreError`] if a query fails, or if a stored design cannot be read.
pub async fn load_brief(
    conn: &mut SqliteConnection,
    request: &StartedDesignRequest,
) -> Result<BriefWithArchive, StoreError> {
    let mut brief = DesignBrief::new(
        request.recipe.clone(),
        request.wanted as usize,
        brief_seed(request.run_seed, request.id),
    );
    if let Some(level) = request.level {
        brief = brief.at_level(&request.levels, level);
    }
    brief.profile = request.profile.clone();
    brief.mastery = request.mastery;
    brief.past_layouts = past_layouts(conn, request).await?;
    brief.time_limit = Some(TIME_LIMIT);
    let known = layouts::archive(conn, &request.run, &request.task, MAX_ARCHIVE).await?;
    let archive = known.iter().map(|text| from_json("a design", text)).collect::<Result<_, _>>()?;
    Ok(BriefWithArchive { brief, archive })
}

/// Returns the seed of a designer's draws, derived from the run's seed and the number of the request.
#[must_use]
pub fn brief_seed(run_seed: u64, request: i64) -> u64 {
    let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 briefs");
    hasher.update(&run_seed.to_le_bytes());
    hasher.update(&request.to_le_bytes());
    let mut bits = [0; 8];
    hasher.finalize_xof().fill(&mut bits);
    u64::from_le_bytes(bits)
}

/// Loads the newest earlier layouts, newest first.
async fn past_layouts(
    conn: &mut SqliteConnection,
    request: &StartedDesignRequest,
) -> Result<Vec<PastLayout>, StoreError> {
    let admitted = LayoutFilter { task: Some(request.task.clone()), ..LayoutFilter::default() };
    let refused = LayoutFilter { state: Some(LayoutState::Refused), with_refused: true, ..admitted.clone() };
    let mut rows = layouts::of_run(conn, &request.run, &admitted, i64::MAX, MAX_ADMITTED).await?;
    rows.extend(layouts::of_run(conn, &request.run, &refused, i64::MAX, MAX_REFUSED).await?);
    rows.sort_by_key(|row| std::cmp::Reverse(row.id));
    let mut past_layouts = Vec::with_capacity(rows.len());
    for row in rows {
        let Some(design) = &row.design else { continue };
        let seed = match &row.scenario {
            Some(id) => scenarios::seed(conn, id).await?.and_then(|seed| Seed::new(seed).ok()),
            None => None,
        };
        past_layouts.push(PastLayout {
            design: from_json("a design", design)?,
            rung: DesignRung::from_stored(request.recipe.task(), row.level, row.start_rung),
            seed,
            outcome: outcome_of(&row),
        });
    }
    Ok(past_layouts)
}

fn outcome_of(row: &LayoutRow) -> LayoutOutcome {
    if row.state == LayoutState::Refused {
        let (check, reason) = (row.gate_check.clone(), row.refusal_reason.clone());
        return LayoutOutcome::Refused {
            check: check.unwrap_or_default(),
            reason: reason.unwrap_or_default(),
        };
    }
    if row.episodes == 0 {
        return LayoutOutcome::Untested;
    }
    let per_episode = |sum: f64| sum / row.episodes as f64;
    LayoutOutcome::Evaluated {
        episodes: to_u32(row.episodes),
        success_rate: per_episode(row.successes as f64),
        regret: per_episode(row.regret_sum),
        aimed_share: row.aimed_failure_share(),
        is_retired: row.state == LayoutState::Retired,
    }
}
