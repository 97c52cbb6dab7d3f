//! One episode: get and replay.

use api_types::{Episode, EpisodeReplay, EpisodeState, ReplayPlan, ReplayQuery};
use axum::Extension;
use axum::extract::State;
use env_core::log::Precision;
use env_core::{ActionLog, Scenario};
use serde_json::{Value, json};
use sqlx::SqliteConnection;
use store::brackets;
use store::episodes::{self, EpisodeRow};
use store::groups::{self, GroupRow};
use store::ids::{EpisodeId, RunId};
use store::leases::LeaseRow;
use store::listed_episodes::EpisodeGroup;
use store::scenarios::ScenarioLoader;
use store::{compacted_leases, from_json};

use super::episode_list::{compacted_summary, episode_summary};
use super::episode_neighbours::episode_neighbours;
use crate::engine::error::ServiceError;
use crate::http::access::{Caller, plan_denial};
use crate::http::extract::{NoQuery, Path, Query};
use crate::http::path_ids::{parse_id, parse_run_id};
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::leases::bracket_view::scenario_bracket;
use crate::leases::find::find_lease;
use env_core::frames::{FrameContent, FrameRange, FramesError, MAX_FRAME_BYTES, frames, wire_step};

/// Get an episode with its scenario, outcome and actions.
#[utoipa::path(
    get, path = "/runs/{run}/episodes/{episode}", tag = "episodes",
    params(("run" = String, Path, description = "The run's id."), ("episode" = String, Path, description = "The episode's id.")),
    responses(
        (status = 200, body = Episode), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The group of the episode is not begun.")
    )
)]
pub(super) async fn get_episode(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, episode)): Path<(String, String)>,
) -> Result<axum::Json<Episode>, Problem> {
    let (run, id): (_, EpisodeId) = (parse_run_id(&run)?, parse_id("episode", &episode)?);
    let mut conn = acquire_run_reader(&app, &run).await?;
    let found = match StoredEpisode::load(&mut conn, &run, id.clone()).await {
        Err(EpisodeError::Expired(_)) => {
            return Ok(axum::Json(compacted_episode(&mut conn, &run, &id).await?));
        }
        found => found?,
    };
    let bracket = brackets::newest(&mut conn, &found.group.scenario).await?;
    let neighbours = episode_neighbours(&mut conn, &run, &found.id, found.lease.group_size).await?;
    let row = found.row;
    let text = |json: Option<&String>| json.map(|j| from_json("a stored value", j)).transpose();
    Ok(axum::Json(Episode {
        summary: episode_summary(
            &run,
            &found.id,
            EpisodeGroup {
                task: found.group.task,
                level: found.group.level,
                role: found.group.role,
                layout: found.group.layout,
            },
            row.as_ref(),
            unreported_state(&found.lease),
        ),
        contested: found.group.is_contested,
        floor: row.as_ref().and_then(|r| r.floor),
        reference: row.as_ref().and_then(|r| r.reference),
        outcome: row
            .as_ref()
            .and_then(|r| r.outcome.as_ref())
            .map(|j| from_json("an outcome", j))
            .transpose()?,
        reason: row.as_ref().and_then(|r| r.reason.clone()),
        metrics: text(row.as_ref().and_then(|r| r.metrics.as_ref()))?,
        scenario_id: Some(found.scenario.id().to_string()),
        bracket: bracket.map(|b| scenario_bracket(&found.scenario, &b)),
        scenario: Some(found.scenario.to_json()),
        actions: found.log.as_ref().map(log_json),
        neighbours,
    }))
}

/// Loads an episode of which only the outcome is kept.
async fn compacted_episode(
    conn: &mut SqliteConnection,
    run: &RunId,
    id: &EpisodeId,
) -> Result<Episode, Problem> {
    let unknown = || ServiceError::UnknownEpisode(id.to_string());
    let lease = compacted_leases::get(conn, run.as_str(), id.lease.number).await?.ok_or_else(unknown)?;
    let group_size = lease.row.group_size.max(1);
    let group = lease.group(id.index / group_size).ok_or_else(unknown)?;
    let neighbours = episode_neighbours(conn, run, id, group_size).await?;
    let known = lease.episode(id.index).map(|(_, known)| known);
    Ok(Episode {
        summary: compacted_summary(&lease, id.index, group, known),
        contested: group.contested,
        floor: None,
        reference: None,
        outcome: None,
        reason: None,
        metrics: None,
        scenario_id: None,
        scenario: None,
        bracket: None,
        actions: None,
        neighbours,
    })
}

/// Replay an episode on the server and return the whole state after each step.
///
/// `plan=reference` replays the planner's plan. The server does not disclose the plan of an evaluation scenario, discloses no plan
/// to tokens with the role trainer, and none while a group of the scenario is open or queued in any run.
#[utoipa::path(
    get, path = "/runs/{run}/episodes/{episode}/replay", tag = "episodes",
    params(("run" = String, Path, description = "The run's id."), ("episode" = String, Path, description = "The episode's id."), ReplayQuery),
    responses(
        (status = 200, body = EpisodeReplay), (status = 400, body = Problem),
        (status = 403, body = Problem, description = "The client may not read the planner's plan."),
        (status = 404, body = Problem, description = "The episode does not exist, or it has no actions."),
        (status = 409, body = Problem,
         description = "The group of the episode is not begun, or the planner's plan is not disclosed while the scenario is in use."),
        (status = 410, body = Problem, description = "The actions of the episode were deleted."),
        (status = 422, body = Problem, description = "The frames exceed 16 MiB.")
    )
)]
pub(super) async fn replay_episode(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path((run, episode)): Path<(String, String)>,
    Query(query): Query<ReplayQuery>,
) -> Result<axum::Json<EpisodeReplay>, Problem> {
    let run = parse_run_id(&run)?;
    let id = parse_id("episode", &episode)?;
    let mut conn = acquire_run_reader(&app, &run).await?;
    let found = StoredEpisode::load(&mut conn, &run, id).await?;
    if query.plan == ReplayPlan::Reference
        && let Some(denial) = plan_denial(&mut conn, &caller, &found.scenario).await?
    {
        return Err(denial.into());
    }
    // The reference plan and the scenario without actions are not disclosed before the episode is reported.
    if found.row.is_none() {
        return Err(ServiceError::UnknownEpisode(format!("{episode} with actions")).into());
    }
    let log = match query.plan {
        ReplayPlan::Agent => {
            found.log.ok_or_else(|| ServiceError::UnknownEpisode(format!("{episode} with actions")))?
        }
        ReplayPlan::Hold => ActionLog::new(found.scenario.task().action_space().dim(), Precision::F64),
        ReplayPlan::Reference => match brackets::newest(&mut conn, &found.group.scenario).await? {
            Some(bracket) => bracket.reference_plan,
            None => return Err(ServiceError::UnknownEpisode(format!("{episode} with a reference")).into()),
        },
    };
    drop(conn);
    // Frames without observations are bounded by the worlds.
    let (content, max_bytes) = if query.telemetry {
        (FrameContent::Telemetry, MAX_FRAME_BYTES)
    } else {
        (FrameContent::State, usize::MAX)
    };
    let scenario = found.scenario.clone();
    let frames =
        tokio::task::spawn_blocking(move || frames(&scenario, &log, content, FrameRange::all(max_bytes)))
            .await;
    let frames = frames.map_err(|_| Problem::internal())?.map_err(|error| match error {
        FramesError::TooLarge { .. } => Problem::invalid("telemetry", error.to_string()),
        FramesError::Scenario(_) | FramesError::Step { .. } => {
            store::StoreError::corrupt("an action log", error).into()
        }
    })?;
    Ok(axum::Json(EpisodeReplay {
        episode: found.id.to_string(),
        scenario: found.scenario.to_json(),
        frames,
    }))
}

/// Episode with its lease, group, log and scenario.
pub(super) struct StoredEpisode {
    pub(super) id: EpisodeId,
    lease: LeaseRow,
    group: GroupRow,
    row: Option<EpisodeRow>,
    pub(super) log: Option<ActionLog>,
    pub(super) scenario: Scenario,
}

impl StoredEpisode {
    pub(super) async fn load(
        conn: &mut SqliteConnection,
        run: &RunId,
        id: EpisodeId,
    ) -> Result<Self, EpisodeError> {
        let unknown = || ServiceError::UnknownEpisode(id.to_string());
        let lease = find_lease(conn, run, &id.lease).await.map_err(|_| unknown())?;
        let Some(group) = groups::get(conn, lease.id, id.index / lease.group_size).await? else {
            let within = lease.is_compacted && id.index < lease.episodes();
            return Err(if within { EpisodeError::Expired(id) } else { unknown().into() });
        };
        if !group.is_disclosed {
            return Err(ServiceError::NotBegun(id.to_string()).into());
        }
        let row = episodes::get(conn, lease.id, id.index).await?;
        if row.is_none() && lease.is_compacted {
            // The group is kept because something depends on another of its episodes.
            let compacted = compacted_leases::get(conn, run.as_str(), lease.id).await?;
            if compacted.is_some_and(|lease| lease.episode(id.index).is_some()) {
                return Err(EpisodeError::Expired(id));
            }
        }
        let log = episodes::log(conn, lease.id, id.index).await?;
        let scenario = ScenarioLoader::default().get(conn, &group.scenario).await?;
        Ok(Self { id, lease, group, row, log, scenario })
    }
}

/// Reason why a complete episode cannot be loaded.
pub(super) enum EpisodeError {
    /// The run keeps only its outcome.
    Expired(EpisodeId),
    /// It does not exist or cannot be read.
    Other(ServiceError),
}

impl<E: Into<ServiceError>> From<E> for EpisodeError {
    fn from(error: E) -> Self {
        Self::Other(error.into())
    }
}

impl From<EpisodeError> for Problem {
    fn from(error: EpisodeError) -> Self {
        match error {
            EpisodeError::Expired(id) => ServiceError::Expired(id.to_string()).into(),
            EpisodeError::Other(error) => error.into(),
        }
    }
}

/// State of an episode that was not reported.
const fn unreported_state(lease: &LeaseRow) -> EpisodeState {
    if lease.is_active() { EpisodeState::Leased } else { EpisodeState::Expired }
}

/// Action log in the form in which results are reported.
fn log_json(log: &ActionLog) -> Value {
    json!({
        "steps": log.steps().map(|action| wire_step(log, action)).collect::<Vec<_>>(),
        "precision": if log.precision() == env_core::log::Precision::F32 { "f32" } else { "f64" },
        "stopped": log.stopped.map(env_core::StopReason::name),
    })
}
