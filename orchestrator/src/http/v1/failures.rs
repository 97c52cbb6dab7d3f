//! The failure profile: why a run's episodes lose score, from where and how fast it comes.

use std::collections::HashMap;

use axum::extract::State;
use env_core::TaskSpec;
use env_core::critique::{FailureModeSpec, BEARING_SECTORS, SpeedBands};
use serde::{Deserialize, Serialize};
use sqlx::{Connection, SqliteConnection};
use utoipa::{IntoParams, ToSchema};

use super::super::extract::{Path, Query};
use super::super::problem::Problem;
use super::run_id;
use crate::clock::rfc3339;
use crate::ids::{EpisodeId, LeaseId, RunId};
use crate::http::state::AppState;
use crate::store::critiques::{self, CritiqueCounters, DecayingSum};
use crate::store::failures::{self, CellEpisode, EXAMPLES_PER_CELL};
use crate::store::{from_json, runs};
use crate::designs::profile::{CollectedProfile, WeightedCell};
use crate::critiques::profile::{weight_of, HALF_LIFE, VERDICTS};
use crate::critiques::sampling;
use crate::engine::error::ServiceError;
use crate::runs::settings::RunSettings;

/// What of a profile is shown.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct Asked {
    /// One task only.
    task: Option<String>,
    /// How many different episodes behind each cell are named, the newest: 0 to 64 (3). Of each cell its newest 64 failures
    /// are kept; where those are of fewer episodes, fewer are named.
    examples: Option<u32>,
}

/// Why a run's episodes lose score.
#[derive(Serialize, ToSchema)]
pub(super) struct Profiles {
    /// The run.
    run: String,
    /// Criticised episodes of a task after which a failure weighs half.
    half_life: f64,
    /// How far the critique is behind.
    #[serde(flatten)]
    backlog: Backlog,
    /// One per task of the run.
    tasks: Vec<Profile>,
}

/// How far the critique of a run is behind its results.
#[derive(Serialize, ToSchema)]
pub(super) struct Backlog {
    /// Episodes that were reported and wait for their critique.
    waiting: i64,
    /// Whether so many wait that only some are criticised. The choice looks at the episode's name alone, so shares stay
    /// unbiased; nothing is scaled up for those that are skipped.
    sampling: bool,
    /// The share that is criticised now.
    share: f64,
}

impl Backlog {
    fn of(waiting: i64) -> Self {
        let halvings = sampling::halvings(waiting);
        Self { waiting, sampling: halvings > 0, share: sampling::share(halvings) }
    }

    /// Where a run stands.
    pub(super) async fn look(conn: &mut SqliteConnection, run: &RunId) -> Result<Self, Problem> {
        let waiting = critiques::waiting_by_task(conn, run.as_str()).await?;
        Ok(Self::of(waiting.values().sum()))
    }
}

/// Why a task's episodes lose score. A failure's weight is 1 when it is entered and halves every half-life.
#[derive(Serialize, ToSchema)]
struct Profile {
    /// The task.
    task: &'static str,
    /// Episodes criticised: what everything below is counted over.
    criticised: i64,
    /// What these episodes weigh together.
    weight: f64,
    /// Episodes that were sampled out, while too many waited.
    skipped: i64,
    /// Episodes that could not be criticised; the server's log says why.
    failed: i64,
    /// Episodes that wait. criticised + skipped + failed + waiting are the finished episodes of training and probes.
    waiting: i64,
    /// The mean of the judge's values, −1 to 1; none before the first.
    judge: Option<Trend>,
    /// Actions per episode by verdict.
    verdicts: Vec<VerdictView>,
    /// The 12 bearing sectors: where the body was, seen from the agent, in degrees from radial out towards in-track.
    sectors: Vec<SectorView>,
    /// The bands of relative speed.
    bands: Vec<BandView>,
    /// The failure modes of the task, those that never occurred included.
    modes: Vec<ModeView>,
}

/// A mean or share: lately, and over all.
#[derive(Serialize, ToSchema)]
struct Trend {
    /// Over the recent episodes: weighted.
    now: f64,
    /// Over all criticised episodes.
    all: f64,
}

impl Trend {
    fn of(now: f64, all: f64, criticised: i64) -> Option<Self> {
        (criticised > 0).then(|| Self { now: now / weight_of(criticised), all: all / criticised as f64 })
    }
}

/// Actions with one verdict.
#[derive(Serialize, ToSchema)]
struct VerdictView {
    /// `needed`, `harmless`, `wasteful` or `harmful`.
    #[schema(value_type = String)]
    verdict: env_core::critique::Verdict,
    /// How many.
    count: i64,
    /// How many an episode.
    per_episode: Option<Trend>,
}

/// A bearing sector.
#[derive(Serialize, ToSchema)]
struct SectorView {
    /// Its number.
    sector: u32,
    /// Its centre; it reaches 15° to either side.
    bearing_deg: f64,
}

/// A band of relative speed.
#[derive(Serialize, ToSchema)]
struct BandView {
    /// Its number.
    band: u32,
    /// From this speed on.
    from: f64,
    /// Below this one; none for the last.
    to: Option<f64>,
    /// The unit of both.
    unit: &'static str,
}

/// A failure mode.
#[derive(Serialize, ToSchema)]
struct ModeView {
    /// Its name.
    mode: String,
    /// What it is, in one sentence.
    about: &'static str,
    /// How often it occurred.
    count: i64,
    /// What that weighs now.
    weight: f64,
    /// How often an episode.
    per_episode: Option<Trend>,
    /// Its share of the task's failures, by weight and by count; none before the first failure.
    share: Option<Trend>,
    /// Where it occurred, by sector and band; cells in which it never did are left out.
    cells: Vec<CellView>,
    /// The same failures by where the body was in the inertial frame: sector 0 is centred on +X, 3 on +Y. Sectors without
    /// failures are left out; empty in a world without such a frame.
    inertial: Vec<InertialView>,
}

/// Failures of one mode from one inertial sector.
#[derive(Serialize, ToSchema)]
struct InertialView {
    /// The sector.
    sector: u32,
    /// How many.
    count: u64,
    /// What they weigh now.
    weight: f64,
}

/// Failures of one mode from one sector at one band of speed.
#[derive(Serialize, ToSchema)]
struct CellView {
    /// The bearing sector; none where nothing was met.
    sector: Option<u32>,
    /// The speed band; none where nothing was met.
    band: Option<u32>,
    /// How many.
    count: i64,
    /// What they weigh now.
    weight: f64,
    /// The share that acting when the body was first visible, within the fuel left, would have avoided; none where nothing
    /// was met.
    avoidable_share: Option<f64>,
    /// The share in which the body was never visible; none where nothing was met.
    unseen_share: Option<f64>,
    /// Mean steps that were left to act; none where nothing was met.
    mean_steps_left: Option<f64>,
    /// When the last one was entered, RFC 3339.
    last_at: String,
    /// The newest episodes behind it, the newest first.
    episodes: Vec<String>,
}

impl CellView {
    fn of(cell: &WeightedCell, episodes: Vec<String>) -> Self {
        let WeightedCell { key, sums, weight, .. } = cell;
        let share = |n: i64| key.encounter.map(|_| n as f64 / sums.count as f64);
        Self {
            sector: key.encounter.map(|bin| bin.sector),
            band: key.encounter.map(|bin| bin.band),
            count: sums.count,
            weight: *weight,
            avoidable_share: share(sums.avoidable),
            unseen_share: share(sums.count - sums.avoidable - sums.unavoidable),
            mean_steps_left: share(sums.steps_left),
            last_at: rfc3339(sums.last_at),
            episodes,
        }
    }
}

/// Show why a run's episodes lose score: failure modes by where it came from and how fast, what actions were worth, and
/// how that changes. Counted over the finished episodes of training and probes, behind the acknowledgement of results;
/// late results and evaluations do not count.
#[utoipa::path(
    get, path = "/runs/{run}/failures", tag = "failures",
    params(("run" = String, Path, description = "The run's id."), Asked),
    responses(
        (status = 200, body = Profiles), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn show(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(asked): Query<Asked>,
) -> Result<axum::Json<Profiles>, Problem> {
    let run = run_id(&run)?;
    let examples = match asked.examples.unwrap_or(3) {
        examples if i64::from(examples) <= EXAMPLES_PER_CELL => i64::from(examples),
        examples => {
            return Err(Problem::invalid("examples", format!("it is {examples}, outside 0 to {EXAMPLES_PER_CELL}")));
        }
    };
    let mut conn = app.readers.acquire().await?;
    let mut conn = conn.begin().await?; // all of one moment
    let tasks = tasks_of(&mut conn, &run, asked.task.as_deref()).await?;
    let waiting = critiques::waiting_by_task(&mut conn, run.as_str()).await?;
    let mut profiles = Vec::with_capacity(tasks.len());
    for task in tasks {
        let of_task = waiting.get(task.id()).copied().unwrap_or(0);
        profiles.push(profile(&mut conn, &run, task, of_task, examples).await?);
    }
    Ok(axum::Json(Profiles {
        run: run.to_string(),
        half_life: HALF_LIFE,
        backlog: Backlog::of(waiting.values().sum()),
        tasks: profiles,
    }))
}

/// The tasks of a run, or the one that is asked for.
pub(super) async fn tasks_of(
    conn: &mut SqliteConnection,
    run: &RunId,
    wanted: Option<&str>,
) -> Result<Vec<&'static dyn TaskSpec>, Problem> {
    let row = runs::get(conn, run.as_str()).await?;
    let row = row.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
    let settings: RunSettings = from_json("a run's settings", &row.settings)?;
    let known: Vec<_> =
        settings.curriculum.tasks.iter().filter_map(|plan| env_core::task(&plan.task)).collect();
    let Some(wanted) = wanted else { return Ok(known) };
    match known.iter().find(|task| task.id() == wanted) {
        Some(task) => Ok(vec![*task]),
        None => {
            let known: Vec<_> = known.iter().map(|task| task.id()).collect();
            let detail = format!("it is none of the run's tasks: {}", known.join(", "));
            Err(Problem::invalid("task", detail))
        }
    }
}

async fn profile(
    conn: &mut SqliteConnection,
    run: &RunId,
    task: &'static dyn TaskSpec,
    waiting: i64,
    examples: i64,
) -> Result<Profile, Problem> {
    let collected = CollectedProfile::read(conn, run.as_str(), task.id()).await?;
    let mut behind: HashMap<i64, Vec<String>> = HashMap::new();
    for shown in failures::newest_episodes(conn, run.as_str(), task.id(), examples).await? {
        let CellEpisode { cell, lease: number, token, number: index } = shown;
        let episode = EpisodeId { lease: LeaseId { number, token }, index }.to_string();
        behind.entry(cell).or_default().push(episode);
    }
    let modes = modes(task.failure_modes(), &collected, &mut behind);
    let weight = collected.weight();
    let CritiqueCounters { criticised, skipped, failed, judged, verdicts } = collected.sums;
    let verdicts = VERDICTS.into_iter().zip(verdicts).map(|(verdict, DecayingSum { all, now })| VerdictView {
        verdict,
        count: all,
        per_episode: Trend::of(now, all as f64, criticised),
    });
    Ok(Profile {
        task: task.id(),
        criticised,
        weight,
        skipped,
        failed,
        waiting,
        judge: Trend::of(judged.now, judged.all, criticised),
        verdicts: verdicts.collect(),
        sectors: (0..BEARING_SECTORS)
            .map(|sector| SectorView { sector, bearing_deg: f64::from(sector) * 360.0 / f64::from(BEARING_SECTORS) })
            .collect(),
        bands: bands(task.speed_bands()),
        modes,
    })
}

fn bands(bands: SpeedBands) -> Vec<BandView> {
    let from = std::iter::once(0.0).chain(bands.edges.iter().copied());
    let to = bands.edges.iter().copied().map(Some).chain([None]);
    (0..).zip(from.zip(to)).map(|(band, (from, to))| BandView { band, from, to, unit: bands.unit }).collect()
}

/// The task's modes in its order, then any that an older version of the world knew.
fn modes(
    specs: &'static [FailureModeSpec],
    collected: &CollectedProfile,
    behind: &mut HashMap<i64, Vec<String>>,
) -> Vec<ModeView> {
    let criticised = collected.sums.criticised;
    let (failures, weights): (i64, f64) =
        collected.cells.iter().fold((0, 0.0), |(n, w), cell| (n + cell.sums.count, w + cell.weight));
    let mut names: Vec<(&str, &'static str)> = specs.iter().map(|spec| (spec.name, spec.about)).collect();
    for known in collected.modes() {
        if !names.iter().any(|(name, _)| *name == known) {
            names.push((known, "of an older version of the world"));
        }
    }
    let mut view = |(name, about): (&str, &'static str)| {
        let mode = collected.mode(name);
        let cells =
            mode.cells.iter().map(|cell| CellView::of(cell, behind.remove(&cell.cell).unwrap_or_default()));
        // Weights that nothing was added to for millions of episodes are zero.
        let now = if weights > 0.0 { mode.weight / weights } else { 0.0 };
        ModeView {
            mode: name.to_owned(),
            about,
            count: mode.count,
            weight: mode.weight,
            per_episode: Trend::of(mode.weight, mode.count as f64, criticised),
            share: (failures > 0).then(|| Trend { now, all: mode.count as f64 / failures as f64 }),
            cells: cells.collect(),
            inertial: mode
                .inertial
                .iter()
                .map(|at| InertialView { sector: at.sector, count: at.count, weight: at.weight })
                .collect(),
        }
    };
    names.into_iter().map(&mut view).collect()
}
