//! Failure profiles of a run's tasks: why episodes lose score, by failure mode, angle and relative speed.

use std::collections::HashMap;

use api_types::{
    CritiqueBacklog, FailureCell, FailureModeCounts, FailureProfile, FailureProfileQuery, FailureProfiles,
    InertialSectorCounts, ProfileSector, SpeedBand, Trend, VerdictCount,
};
use axum::extract::State;
use env_core::TaskSpec;
use env_core::critique::{FailureModeSpec, PROFILE_SECTORS, SpeedBands};
use sqlx::SqliteConnection;
use store::critiques::{self, CritiqueCounters, DecayingSum};
use store::failures::{self, CellEpisode, EXAMPLES_PER_CELL};
use store::ids::{EpisodeId, LeaseId, RunId};

use super::episode_critique::action_verdict;
use super::tasks::sector_quantity;
use crate::critiques::profile::{HALF_LIFE, total_weight};
use crate::critiques::sampling;
use crate::designs::profile::{CollectedProfile, WeightedCell};
use crate::http::extract::{Path, Query};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::find_run_tasks;
use crate::http::state::AppState;
use clock::rfc3339;
use jobs::critique::VERDICTS;

/// Backlog of the critique with this number of waiting episodes.
fn backlog(waiting: i64) -> CritiqueBacklog {
    let halvings = sampling::halvings(waiting);
    CritiqueBacklog { waiting, sampling: halvings > 0, sampled_share: sampling::share(halvings) }
}

/// Reads the backlog of a run's critique.
///
/// # Errors
/// Returns a problem if the query fails.
pub(super) async fn critique_backlog(
    conn: &mut SqliteConnection,
    run: &RunId,
) -> Result<CritiqueBacklog, Problem> {
    let waiting = critiques::waiting_by_task(conn, run.as_str()).await?;
    Ok(backlog(waiting.values().sum()))
}

/// Get the failure profiles of a run's tasks.
///
/// A profile has failure modes by angle and relative speed, verdicts on actions, and their trends. It counts finished episodes of
/// training and probes, soon after the server acknowledged their results. It does not count late results and evaluations.
#[utoipa::path(
    get, path = "/runs/{run}/failure_profiles", tag = "failures",
    params(("run" = String, Path, description = "The run's id."), FailureProfileQuery),
    responses(
        (status = 200, body = FailureProfiles), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn get_failure_profiles(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(query): Query<FailureProfileQuery>,
) -> Result<axum::Json<FailureProfiles>, Problem> {
    let run = parse_run_id(&run)?;
    let examples = match query.examples.unwrap_or(3) {
        examples if i64::from(examples) <= EXAMPLES_PER_CELL => i64::from(examples),
        examples => {
            return Err(Problem::invalid(
                "examples",
                format!("must be from 0 to {EXAMPLES_PER_CELL}, got {examples}"),
            ));
        }
    };
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let tasks = find_run_tasks(&mut conn, &run, query.task.as_deref()).await?;
    let waiting = critiques::waiting_by_task(&mut conn, run.as_str()).await?;
    let mut profiles = Vec::with_capacity(tasks.len());
    for task in tasks {
        let of_task = waiting.get(task.id()).copied().unwrap_or(0);
        profiles.push(failure_profile(&mut conn, &run, task, of_task, examples).await?);
    }
    Ok(axum::Json(FailureProfiles {
        run: run.to_string(),
        half_life: HALF_LIFE,
        backlog: backlog(waiting.values().sum()),
        tasks: profiles,
    }))
}

async fn failure_profile(
    conn: &mut SqliteConnection,
    run: &RunId,
    task: &'static dyn TaskSpec,
    waiting: i64,
    examples: i64,
) -> Result<FailureProfile, Problem> {
    let collected = CollectedProfile::load(conn, run.as_str(), task.id()).await?;
    let mut examples_by_cell: HashMap<i64, Vec<String>> = HashMap::new();
    for shown in failures::newest_episodes(conn, run.as_str(), task.id(), examples).await? {
        let CellEpisode { cell, lease: number, id_suffix: suffix, number: index } = shown;
        let episode = EpisodeId { lease: LeaseId { number, suffix }, index }.to_string();
        examples_by_cell.entry(cell).or_default().push(episode);
    }
    let modes = failure_modes(task.failure_modes(), &collected, &mut examples_by_cell);
    let weight = collected.weight();
    let CritiqueCounters { criticised, skipped, failed, judgement, verdicts } = collected.counters;
    let verdicts =
        VERDICTS.into_iter().zip(verdicts).map(|(verdict, DecayingSum { overall, recent })| VerdictCount {
            verdict: action_verdict(verdict),
            count: overall,
            per_episode: trend(recent, overall as f64, criticised),
        });
    Ok(FailureProfile {
        task: task.id().to_owned(),
        criticised,
        weight,
        skipped,
        failed,
        waiting,
        judge: trend(judgement.recent, judgement.overall, criticised),
        verdicts: verdicts.collect(),
        sectors: (0..PROFILE_SECTORS)
            .map(|sector| ProfileSector {
                sector,
                angle_deg: f64::from(sector) * 360.0 / f64::from(PROFILE_SECTORS),
            })
            .collect(),
        sector_quantity: sector_quantity(task.sector_quantity()),
        bands: speed_bands(task.speed_bands()),
        modes,
    })
}

fn speed_bands(bands: SpeedBands) -> Vec<SpeedBand> {
    let from = std::iter::once(0.0).chain(bands.edges.iter().copied());
    let to = bands.edges.iter().copied().map(Some).chain([None]);
    (0..)
        .zip(from.zip(to))
        .map(|(band, (from, to))| SpeedBand { band, from, to, unit: bands.unit.to_owned() })
        .collect()
}

/// Failure modes of the task in its order, then modes that only an older version of the world has.
fn failure_modes(
    specs: &'static [FailureModeSpec],
    collected: &CollectedProfile,
    examples: &mut HashMap<i64, Vec<String>>,
) -> Vec<FailureModeCounts> {
    let criticised = collected.counters.criticised;
    let (failures, weights): (i64, f64) =
        collected.cells.iter().fold((0, 0.0), |(n, w), cell| (n + cell.counters.count, w + cell.weight));
    let mut names: Vec<(&str, &'static str)> =
        specs.iter().map(|spec| (spec.name, spec.description)).collect();
    for known in collected.modes() {
        if !names.iter().any(|(name, _)| *name == known) {
            names.push((known, "failure mode of an older version of the world"));
        }
    }
    let mut view = |(name, description): (&str, &'static str)| {
        let mode = collected.mode(name);
        let cells =
            mode.cells.iter().map(|cell| failure_cell(cell, examples.remove(&cell.cell).unwrap_or_default()));
        // Weights decay to zero if no failure is added for millions of episodes.
        let recent = if weights > 0.0 { mode.weight / weights } else { 0.0 };
        FailureModeCounts {
            mode: name.to_owned(),
            description: description.to_owned(),
            count: mode.count,
            weight: mode.weight,
            per_episode: trend(mode.weight, mode.count as f64, criticised),
            share: (failures > 0).then(|| Trend { recent, overall: mode.count as f64 / failures as f64 }),
            cells: cells.collect(),
            inertial_sectors: mode
                .inertial
                .iter()
                .map(|at| InertialSectorCounts { sector: at.sector, count: at.count, weight: at.weight })
                .collect(),
        }
    };
    names.into_iter().map(&mut view).collect()
}

/// Trend of a weighted and a total sum over criticised episodes; `None` before the first episode.
fn trend(recent: f64, overall: f64, criticised: i64) -> Option<Trend> {
    (criticised > 0)
        .then(|| Trend { recent: recent / total_weight(criticised), overall: overall / criticised as f64 })
}

fn failure_cell(cell: &WeightedCell, episodes: Vec<String>) -> FailureCell {
    let WeightedCell { key, counters, weight, .. } = cell;
    let share = |n: i64| key.band.map(|_| n as f64 / counters.count as f64);
    FailureCell {
        sector: key.sector,
        band: key.band,
        count: counters.count,
        weight: *weight,
        avoidable_share: share(counters.avoidable),
        unseen_share: share(counters.count - counters.avoidable - counters.unavoidable),
        mean_steps_left: share(counters.steps_left),
        last_at: rfc3339(counters.last_at),
        episodes,
    }
}
