//! Episodes: show, replay.

use axum::extract::State;
use env_core::log::Precision;
use env_core::{ActionLog, Scenario};
use serde::Serialize;
use serde_json::{Value, json};
use sqlx::SqliteConnection;
use utoipa::ToSchema;

use super::super::extract::{NoQuery, Path, Query};
use super::super::problem::Problem;
use super::episode_list::EpisodeHead;
use super::{id, run_id};
use crate::frames::{FrameContent, FrameRange, FramesError, MAX_FRAME_BYTES, frames, wire_step};
use crate::ids::{EpisodeId, RunId};
use crate::http::state::AppState;
use crate::store::brackets::{self, StoredOutcome};
use crate::store::episodes::{self, EpisodeGroup, EpisodeRow};
use crate::store::groups::{self, GroupRow};
use crate::store::leases::LeaseRow;
use crate::store::scenarios::ScenarioLoader;
use crate::store::{compacted_leases, from_json};
use crate::leases::bracket_view::BracketView;
use crate::engine::error::ServiceError;
use crate::leases::find::find_lease;

/// One episode with its scenario.
#[derive(Serialize, ToSchema)]
pub(super) struct Episode {
    /// What a list says of it.
    #[serde(flatten)]
    head: EpisodeHead,
    /// Whether the scenario is contested.
    contested: bool,
    /// The floor it was judged by.
    floor: Option<f64>,
    /// The reference score it was judged by.
    reference: Option<f64>,
    /// How it was flown.
    flown: Option<StoredOutcome>,
    /// Why it failed.
    reason: Option<String>,
    /// What the trainer logged.
    #[schema(value_type = Option<Object>)]
    metrics: Option<Value>,
    /// The scenario's id; none past what the run keeps whole.
    scenario_id: Option<String>,
    /// The scenario, complete; likewise.
    #[schema(value_type = Option<Object>)]
    scenario: Option<Value>,
    /// What the scenario is worth.
    bracket: Option<BracketView>,
    /// The actions, one entry a step: a list of `[agent, value, …]`.
    #[schema(value_type = Option<Object>)]
    actions: Option<Value>,
}

/// A replay, step by step.
#[derive(Serialize, ToSchema)]
pub(super) struct Replay {
    /// The episode.
    episode: String,
    /// The scenario, complete.
    #[schema(value_type = Object)]
    scenario: Value,
    /// The start, then one frame a step: actions, rewards, and the whole state, hidden bodies included; with
    /// `telemetry=true` also `observation`, what the agents saw.
    #[schema(value_type = Vec<Object>)]
    frames: Vec<Value>,
}

/// Show an episode: its scenario, and how it went.
#[utoipa::path(
    get, path = "/runs/{run}/episodes/{episode}", tag = "episodes",
    params(("run" = String, Path, description = "The run's id."), ("episode" = String, Path, description = "The episode's id.")),
    responses((status = 200, body = Episode), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(super) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, episode)): Path<(String, String)>,
) -> Result<axum::Json<Episode>, Problem> {
    let (run, id): (_, EpisodeId) = (run_id(&run)?, id("episode", &episode)?);
    let mut conn = app.readers.acquire().await?;
    let found = match Found::look(&mut conn, &run, id.clone()).await {
        Err(NotFound::Expired(_)) => return Ok(axum::Json(past(&mut conn, &run, &id).await?)),
        found => found?,
    };
    let bracket = brackets::newest(&mut conn, &found.group.scenario).await?;
    let row = found.row;
    let text = |json: Option<&String>| json.map(|j| from_json("a stored value", j)).transpose();
    Ok(axum::Json(Episode {
        head: EpisodeHead::of(
            &found.id,
            EpisodeGroup {
                task: found.group.task,
                level: found.group.level,
                role: found.group.role,
                layout: found.group.layout,
            },
            row.as_ref(),
            unreported(&found.lease),
        ),
        contested: found.group.is_contested,
        floor: row.as_ref().and_then(|r| r.floor),
        reference: row.as_ref().and_then(|r| r.reference),
        flown: row.as_ref().and_then(|r| r.flown.as_ref()).map(|j| from_json("a flight", j)).transpose()?,
        reason: row.as_ref().and_then(|r| r.reason.clone()),
        metrics: text(row.as_ref().and_then(|r| r.metrics.as_ref()))?,
        scenario_id: Some(found.scenario.id().to_string()),
        bracket: bracket.map(|b| BracketView::of(&found.scenario, &b)),
        scenario: Some(found.scenario.to_json()),
        actions: found.log.as_ref().map(steps),
    }))
}

/// An episode of which only is kept how it came out.
async fn past(conn: &mut SqliteConnection, run: &RunId, id: &EpisodeId) -> Result<Episode, Problem> {
    let unknown = || ServiceError::UnknownEpisode(id.to_string());
    let lease = compacted_leases::get(conn, run.as_str(), id.lease.number).await?.ok_or_else(unknown)?;
    let group = lease.group(id.index / lease.row.group_size.max(1)).ok_or_else(unknown)?;
    let known = lease.episode(id.index).map(|(_, known)| known);
    Ok(Episode {
        head: EpisodeHead::folded(&lease, id.index, (group, known)),
        contested: group.contested,
        floor: None,
        reference: None,
        flown: None,
        reason: None,
        metrics: None,
        scenario_id: None,
        scenario: None,
        bracket: None,
        actions: None,
    })
}

/// What a replay shows.
#[derive(Debug, serde::Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Shown {
    /// Whether frames also hold what the agents saw (false).
    #[serde(default)]
    telemetry: bool,
    /// Who flies it: the agent, as it did; nobody; or the plan that the scenario's reference score is of (agent).
    #[serde(default)]
    #[param(inline)]
    plan: Plan,
}

/// Whose actions are replayed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
enum Plan {
    /// The agent's.
    #[default]
    Agent,
    /// None.
    Hold,
    /// Those that earn the reference score.
    Reference,
}

/// Replay an episode on the server: the whole state, step by step.
#[utoipa::path(
    get, path = "/runs/{run}/episodes/{episode}/replay", tag = "episodes",
    params(("run" = String, Path, description = "The run's id."), ("episode" = String, Path, description = "The episode's id."), Shown),
    responses(
        (status = 200, body = Replay), (status = 400, body = Problem),
        (status = 404, body = Problem, description = "No such episode, or one that was never flown."),
        (status = 410, body = Problem, description = "The run keeps its actions no longer."),
        (status = 422, body = Problem, description = "More to show than 16 MiB.")
    )
)]
pub(super) async fn replayed(
    State(app): State<AppState>,
    Path((run, episode)): Path<(String, String)>,
    Query(shown): Query<Shown>,
) -> Result<axum::Json<Replay>, Problem> {
    let mut conn = app.readers.acquire().await?;
    let found = Found::look(&mut conn, &run_id(&run)?, id("episode", &episode)?).await?;
    // What earns the reference score, and how it looks where nobody acts, is told of what was flown: not to who is to fly it yet.
    if found.row.is_none() {
        return Err(ServiceError::UnknownEpisode(format!("{episode} that was flown")).into());
    }
    let log = match shown.plan {
        Plan::Agent => {
            found.log.ok_or_else(|| ServiceError::UnknownEpisode(format!("{episode} that was flown")))?
        }
        Plan::Hold => ActionLog::new(found.scenario.task().action_space().columns.len(), Precision::F64),
        Plan::Reference => match brackets::newest(&mut conn, &found.group.scenario).await? {
            Some(bracket) => bracket.reference_plan,
            None => return Err(ServiceError::UnknownEpisode(format!("{episode} with a reference")).into()),
        },
    };
    drop(conn);
    // States alone were always shown in full; the worlds bound them.
    let (content, max_bytes) =
        if shown.telemetry { (FrameContent::Telemetry, MAX_FRAME_BYTES) } else { (FrameContent::State, usize::MAX) };
    let scenario = found.scenario.clone();
    let frames = tokio::task::spawn_blocking(move || frames(&scenario, &log, content, FrameRange::all(max_bytes)))
        .await;
    let frames = frames.map_err(|_| Problem::internal())?.map_err(|error| match error {
        FramesError::TooLarge { .. } => Problem::invalid("telemetry", error.to_string()),
        FramesError::Scenario(_) | FramesError::Step { .. } => {
            crate::store::StoreError::corrupt("an action log", error).into()
        }
    })?;
    Ok(axum::Json(Replay { episode: found.id.to_string(), scenario: found.scenario.to_json(), frames }))
}

/// An episode and everything around it.
pub(super) struct Found {
    pub(super) id: EpisodeId,
    lease: LeaseRow,
    group: GroupRow,
    row: Option<EpisodeRow>,
    pub(super) log: Option<ActionLog>,
    pub(super) scenario: Scenario,
}

impl Found {
    pub(super) async fn look(
        conn: &mut SqliteConnection,
        run: &RunId,
        id: EpisodeId,
    ) -> Result<Self, NotFound> {
        let unknown = || ServiceError::UnknownEpisode(id.to_string());
        let lease = find_lease(conn, run, &id.lease).await.map_err(|_| unknown())?;
        let Some(group) = groups::get(conn, lease.id, id.index / lease.group_size).await? else {
            let within = lease.is_compacted && id.index < lease.episodes();
            return Err(if within { NotFound::Expired(id) } else { unknown().into() });
        };
        let row = episodes::get(conn, lease.id, id.index).await?;
        if row.is_none() && lease.is_compacted {
            // Something rests on another of its group.
            let folded = compacted_leases::get(conn, run.as_str(), lease.id).await?;
            if folded.is_some_and(|folded| folded.episode(id.index).is_some()) {
                return Err(NotFound::Expired(id));
            }
        }
        let log = episodes::log(conn, lease.id, id.index).await?;
        let scenario = ScenarioLoader::default().get(conn, &group.scenario).await?;
        Ok(Self { id, lease, group, row, log, scenario })
    }
}

/// Why an episode is not there, whole.
pub(super) enum NotFound {
    /// The run keeps it whole no longer.
    Expired(EpisodeId),
    /// There is none, or it cannot be read.
    Other(ServiceError),
}

impl<E: Into<ServiceError>> From<E> for NotFound {
    fn from(error: E) -> Self {
        Self::Other(error.into())
    }
}

impl From<NotFound> for Problem {
    fn from(not: NotFound) -> Self {
        match not {
            NotFound::Expired(id) => ServiceError::Expired(id.to_string()).into(),
            NotFound::Other(error) => error.into(),
        }
    }
}

fn unreported(lease: &LeaseRow) -> &'static str {
    if lease.is_active() { "leased" } else { "expired" }
}

fn steps(log: &ActionLog) -> Value {
    json!({
        "steps": log.steps().map(|action| wire_step(log, action)).collect::<Vec<_>>(),
        "precision": if log.precision() == env_core::log::Precision::F32 { "f32" } else { "f64" },
        "stopped": log.stopped.map(env_core::StopReason::name),
    })
}
