//! What a designer is told, gathered from the store.

use std::time::Duration;

use designer::brief::{DesignBrief, LayoutOutcome, PastLayout};
use env_core::Seed;
use serde_json::Value;
use sqlx::SqliteConnection;

use crate::designs::design_request::StartedDesignRequest;
use crate::store::layouts::{self, LayoutFilter, LayoutRow, LayoutState};
use crate::store::{StoreError, from_json, scenarios, to_u32};

/// Earlier layouts that a designer hears of: those let through, and those refused. Counted apart, so that a bad round does
/// not make it forget what worked.
const FATES: (i64, i64) = (24, 8);
/// How long a designer may take: then it ends with what it has.
const PATIENCE: Duration = Duration::from_secs(540);
/// Earlier designs that a new one is compared with.
const ARCHIVE: i64 = 500;

/// The brief of an ask that was begun, and the designs that the gate knows.
///
/// # Errors
/// The database's, or a design that cannot be read back.
pub async fn gather(conn: &mut SqliteConnection, begun: &StartedDesignRequest) -> Result<(DesignBrief, Vec<Value>), StoreError> {
    let mut brief = DesignBrief::new(begun.base.clone(), begun.wanted as usize, seed(begun.run_seed, begun.ask));
    if let Some(level) = begun.level {
        brief = brief.at_level(&begun.levels, level);
    }
    brief.profile = begun.profile.clone();
    brief.mastery = begun.standing;
    brief.past_layouts = fates(conn, begun).await?;
    brief.time_limit = Some(PATIENCE);
    let known = layouts::archive(conn, &begun.run, &begun.task, ARCHIVE).await?;
    let archive = known.iter().map(|text| from_json("a design", text)).collect::<Result<_, _>>()?;
    Ok((brief, archive))
}

/// What a designer's draws follow from: the run and the ask.
#[must_use]
pub fn seed(run_seed: u64, ask: i64) -> u64 {
    let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 briefs");
    hasher.update(&run_seed.to_le_bytes());
    hasher.update(&ask.to_le_bytes());
    let mut bits = [0; 8];
    hasher.finalize_xof().fill(&mut bits);
    u64::from_le_bytes(bits)
}

async fn fates(conn: &mut SqliteConnection, begun: &StartedDesignRequest) -> Result<Vec<PastLayout>, StoreError> {
    let passed = LayoutFilter { task: Some(begun.task.clone()), ..LayoutFilter::default() };
    let refused = LayoutFilter { state: Some(LayoutState::Refused), with_refused: true, ..passed.clone() };
    let mut rows = layouts::of_run(conn, &begun.run, &passed, i64::MAX, FATES.0).await?;
    rows.extend(layouts::of_run(conn, &begun.run, &refused, i64::MAX, FATES.1).await?);
    rows.sort_by_key(|row| std::cmp::Reverse(row.id));
    let mut fates = Vec::with_capacity(rows.len());
    for row in rows {
        let Some(design) = &row.design else { continue };
        let sky = match &row.scenario {
            Some(id) => scenarios::seed(conn, id).await?.and_then(|seed| Seed::new(seed).ok()),
            None => None,
        };
        fates.push(PastLayout { design: from_json("a design", design)?, seed: sky, outcome: fate(&row) });
    }
    Ok(fates)
}

fn fate(row: &LayoutRow) -> LayoutOutcome {
    if row.state == LayoutState::Refused {
        let (check, reason) = (row.gate_check.clone(), row.reason.clone());
        return LayoutOutcome::Refused { check: check.unwrap_or_default(), reason: reason.unwrap_or_default() };
    }
    if row.episodes == 0 {
        return LayoutOutcome::Untested;
    }
    let over = |sum: f64| sum / row.episodes as f64;
    LayoutOutcome::Evaluated {
        episodes: to_u32(row.episodes),
        success_rate: over(row.successes as f64),
        regret: over(row.regret),
        aimed_share: row.as_aimed_share(),
        is_retired: row.state == LayoutState::Retired,
    }
}
