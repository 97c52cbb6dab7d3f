//! Reported episodes by what they are of and how they came out, in any order.

use crate::store::groups::GroupRole;
use crate::store::episodes::EpisodeState;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use sqlx::SqliteConnection;
use utoipa::{IntoParams, ToSchema};

use super::super::extract::{Path, Query};
use super::super::problem::Problem;
use super::episode_list::{EpisodeHead, head};
use super::failures::tasks_of;
use super::{Page, id, next, reader_of, run_id};
use crate::ids::{LayoutId, RunId};
use crate::http::state::AppState;
use crate::store::episode_search::{self, OrderValue, EpisodeOrder, EpisodeCursor, EpisodeFilter};

/// Which episodes are looked for, and in which order.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct Looked {
    /// Of this task.
    task: Option<String>,
    /// Of this level.
    level: Option<u32>,
    /// How it came back.
    #[param(inline)]
    state: Option<StateWord>,
    /// Successes (true), or what are none (false).
    success: Option<bool>,
    /// In which this failure mode was found: of those that are kept as examples of it.
    mode: Option<String>,
    /// Of groups of this role.
    #[param(inline)]
    role: Option<RoleWord>,
    /// On this layout.
    layout: Option<String>,
    /// Flown by this version of the policy.
    version: Option<u32>,
    /// In which order (newest).
    #[serde(default)]
    #[param(inline)]
    order: OrderWord,
    /// How many at most: 1 to 500 (50).
    limit: Option<u32>,
    /// `next` of the page before, asked for with the same words.
    cursor: Option<String>,
}

/// How an episode came back.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
enum StateWord {
    /// Flown to its end.
    Finished,
    /// The trainer could not fly it.
    Failed,
    /// After its lease had ended.
    Late,
}

/// What a group was for.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
enum RoleWord {
    /// To find the level at which a new run starts.
    Placement,
    /// The current level.
    Frontier,
    /// A level already passed.
    Rehearsal,
    /// Drawn by a strategy without levels to climb.
    Sample,
    /// A scenario that nobody had seen.
    Explore,
    /// A scenario again that has something to teach.
    Replay,
    /// An edit of such a scenario.
    Edit,
    /// One param at its bound.
    Boundary,
    /// A designed layout.
    Designed,
    /// An evaluation's.
    Suite,
}

/// A word as it is sent.
fn word(word: impl Serialize) -> Option<String> {
    serde_json::to_value(word).ok()?.as_str().map(str::to_owned)
}

impl From<StateWord> for EpisodeState {
    fn from(word: StateWord) -> Self {
        match word {
            StateWord::Finished => Self::Finished,
            StateWord::Failed => Self::Failed,
            StateWord::Late => Self::Late,
        }
    }
}

impl From<RoleWord> for GroupRole {
    fn from(word: RoleWord) -> Self {
        match word {
            RoleWord::Placement => Self::Placement,
            RoleWord::Frontier => Self::Frontier,
            RoleWord::Rehearsal => Self::Rehearsal,
            RoleWord::Sample => Self::Sample,
            RoleWord::Explore => Self::Explore,
            RoleWord::Replay => Self::Replay,
            RoleWord::Edit => Self::Edit,
            RoleWord::Boundary => Self::Boundary,
            RoleWord::Designed => Self::Designed,
            RoleWord::Suite => Self::Suite,
        }
    }
}

/// An order of episodes.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
enum OrderWord {
    /// The last that was leased first.
    #[default]
    Newest,
    /// The first that was leased first.
    Oldest,
    /// The lowest score first.
    WorstScore,
    /// The highest score first.
    BestScore,
    /// The lowest skill first.
    WorstSkill,
    /// The highest skill first.
    BestSkill,
}

impl From<OrderWord> for EpisodeOrder {
    fn from(word: OrderWord) -> Self {
        let by = |value, descending| Self::ByValue { value, descending };
        match word {
            OrderWord::Newest => Self::Newest,
            OrderWord::Oldest => Self::Oldest,
            OrderWord::WorstScore => by(OrderValue::Score, false),
            OrderWord::BestScore => by(OrderValue::Score, true),
            OrderWord::WorstSkill => by(OrderValue::Skill, false),
            OrderWord::BestSkill => by(OrderValue::Skill, true),
        }
    }
}

/// A page of episodes that were looked for.
#[derive(Serialize, ToSchema)]
pub(super) struct FoundEpisodes {
    /// In the order asked for.
    episodes: Vec<EpisodeHead>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// Look for reported episodes, of those that are kept whole: `GET …/episodes` lists all, the oldest first. Orders by score and skill leave out
/// those that have none.
#[utoipa::path(
    get, path = "/runs/{run}/episodes/search", tag = "episodes", operation_id = "search_episodes",
    params(("run" = String, Path, description = "The run's id."), Looked),
    responses(
        (status = 200, body = FoundEpisodes), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn search(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(looked): Query<Looked>,
) -> Result<axum::Json<FoundEpisodes>, Problem> {
    let run = run_id(&run)?;
    let page = Page { limit: looked.limit, cursor: looked.cursor };
    let (limit, after, order) = (page.limit()?, place(&page, looked.order)?, EpisodeOrder::from(looked.order));
    let layout = looked.layout.as_deref().map(|text| id::<LayoutId>("layout", text)).transpose()?;
    let wanted = EpisodeFilter {
        task: looked.task,
        level: looked.level.map(i64::from),
        state: looked.state.map(EpisodeState::from),
        success: looked.success,
        mode: looked.mode,
        role: looked.role.map(GroupRole::from),
        layout: layout.map(|id| id.0),
        version: looked.version.map(i64::from),
    };
    // What few have is looked for among all: that is not for many at once.
    let _turn = app.turns.searches.turn().await?;
    let mut conn = reader_of(&app, &run).await?;
    known(&mut conn, &run, &wanted).await?;
    let found = episode_search::page(&mut conn, run.as_str(), &wanted, order, after, limit).await?;
    let order_word = word(looked.order).unwrap_or_default();
    let last = found.last().map(|listed| {
        let value = match order {
            EpisodeOrder::ByValue { value: OrderValue::Score, .. } => listed.row.score,
            EpisodeOrder::ByValue { value: OrderValue::Skill, .. } => listed.row.skill,
            EpisodeOrder::Newest | EpisodeOrder::Oldest => None,
        };
        (
            listed.row.lease,
            format!("{}_{:016x}_{order_word}", listed.row.number, value.unwrap_or_default().to_bits()),
        )
    });
    let next = next(found.len(), limit, last.as_ref().map(|(lease, rest)| (*lease, rest.as_str())));
    Ok(axum::Json(FoundEpisodes { episodes: found.into_iter().map(|listed| head(listed).1).collect(), next }))
}

/// Whether there are such episodes at all: of a task that the service has, and in modes that its critique knows.
async fn known(conn: &mut SqliteConnection, run: &RunId, wanted: &EpisodeFilter) -> Result<(), Problem> {
    let tasks = match &wanted.task {
        Some(id) => vec![
            env_core::task(id).ok_or_else(|| Problem::invalid("task", format!("there is no task {id}")))?,
        ],
        None => tasks_of(conn, run, None).await?,
    };
    let Some(mode) = &wanted.mode else { return Ok(()) };
    let mut modes: Vec<_> =
        tasks.iter().flat_map(|task| task.failure_modes()).map(|spec| spec.name).collect();
    if modes.iter().any(|known| known == mode) {
        return Ok(());
    }
    modes.sort_unstable();
    modes.dedup();
    Err(Problem::invalid("mode", format!("there is no such mode; there are {}", modes.join(", "))))
}

/// Where a cursor goes on.
fn place(page: &Page, order: OrderWord) -> Result<Option<EpisodeCursor>, Problem> {
    if page.cursor.is_none() {
        return Ok(None);
    }
    let (lease, rest) = page.cursor()?;
    let read = || {
        let (number, rest) = rest.split_once('_')?;
        let (bits, of) = rest.split_once('_')?;
        let value = f64::from_bits(u64::from_str_radix(bits, 16).ok()?);
        let place =
            value.is_finite().then_some(EpisodeCursor { value: Some(value), lease, number: number.parse().ok()? });
        Some((place?, of))
    };
    match read() {
        Some((place, of)) if word(order).as_deref() == Some(of) => Ok(Some(place)),
        Some((_, of)) => Err(Problem::invalid("cursor", format!("it is of a page in another order: {of}"))),
        None => Err(Problem::invalid("cursor", "it is not one that a search gave")),
    }
}
