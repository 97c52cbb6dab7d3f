//! Search for reported episodes by task, outcome and group, in several orders.

use crate::api_enums::ConvertEnum;
use api_types::{EpisodePage, EpisodeSearchQuery, EpisodeSortOrder, EpisodeStateFilter};
use axum::extract::State;
use sqlx::SqliteConnection;
use store::episode_search::{self, EpisodeCursor, EpisodeFilter, EpisodeOrder, OrderValue};
use store::episodes::EpisodeState;
use store::ids::{LayoutId, RunId};

use super::episode_list::listed_summary;
use crate::http::extract::{Path, Query};
use crate::http::filters::check_failure_mode;
use crate::http::paging::{PageCursor, next_cursor, page_limit};
use crate::http::path_ids::{parse_id, parse_run_id};
use crate::http::problem::Problem;
use crate::http::run_reader::{acquire_run_reader, find_run_tasks};
use crate::http::state::AppState;

/// Search for reported episodes that the run keeps complete.
///
/// `GET …/episodes` lists all episodes, oldest first. An order by score or skill leaves out episodes without one.
#[utoipa::path(
    get, path = "/runs/{run}/episodes/search", tag = "episodes",     params(("run" = String, Path, description = "The run's id."), EpisodeSearchQuery),
    responses(
        (status = 200, body = EpisodePage), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn search_episodes(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(query): Query<EpisodeSearchQuery>,
) -> Result<axum::Json<EpisodePage>, Problem> {
    let run = parse_run_id(&run)?;
    let (limit, order) = (page_limit(query.limit)?, stored_order(query.order));
    let after = episode_after(query.cursor.as_deref(), query.order)?;
    let layout = query.layout.as_deref().map(|text| parse_id::<LayoutId>("layout", text)).transpose()?;
    let filter = EpisodeFilter {
        task: query.task,
        level: query.level.map(i64::from),
        state: query.state.map(stored_state),
        success: query.success,
        mode: query.mode,
        role: query.role.map(ConvertEnum::convert),
        layout: layout.map(|id| id.number),
        version: query.policy_version.map(i64::from),
    };
    // A filter that matches few episodes scans all of them, so that few searches may run at once.
    let _permit = app.concurrency.searches.acquire().await?;
    let mut conn = acquire_run_reader(&app, &run).await?;
    check_filter(&mut conn, &run, &filter).await?;
    let found = episode_search::page(&mut conn, run.as_str(), &filter, order, after, limit).await?;
    let order_word = order_word(query.order);
    let key = found.last().map(|listed| {
        let value = match order {
            EpisodeOrder::ByValue { value: OrderValue::Score, .. } => listed.row.score,
            EpisodeOrder::ByValue { value: OrderValue::Skill, .. } => listed.row.skill,
            EpisodeOrder::Newest | EpisodeOrder::Oldest => None,
        };
        format!("{}_{:016x}_{order_word}", listed.row.number, value.unwrap_or_default().to_bits())
    });
    let last = found.last().zip(key.as_deref());
    let last = last.map(|(listed, text)| PageCursor { number: listed.row.lease, text });
    let next = next_cursor(found.len(), limit, last);
    Ok(axum::Json(EpisodePage {
        episodes: found.into_iter().map(|listed| listed_summary(&run, listed)).collect(),
        next,
    }))
}

/// Checks that the task of a filter exists and that its tasks have the failure mode.
async fn check_filter(
    conn: &mut SqliteConnection,
    run: &RunId,
    filter: &EpisodeFilter,
) -> Result<(), Problem> {
    let tasks = match &filter.task {
        Some(id) => vec![env_core::task(id).ok_or_else(|| {
            Problem::invalid("task", format!("task {id} does not exist; `GET /v1/tasks` lists all tasks"))
        })?],
        None => find_run_tasks(conn, run, None).await?,
    };
    check_failure_mode("mode", filter.mode.as_ref(), &tasks)
}

/// Episode after which a page starts. The cursor is `lease.number_score_order` with the bits of the score or skill.
fn episode_after(cursor: Option<&str>, order: EpisodeSortOrder) -> Result<Option<EpisodeCursor>, Problem> {
    let Some(PageCursor { number: lease, text }) = PageCursor::parse(cursor)? else { return Ok(None) };
    let parse = || {
        let (number, rest) = text.split_once('_')?;
        let (bits, word) = rest.split_once('_')?;
        let value =
            Some(f64::from_bits(u64::from_str_radix(bits, 16).ok()?)).filter(|value| value.is_finite())?;
        Some((EpisodeCursor { value: Some(value), lease, number: number.parse().ok()? }, word))
    };
    match parse() {
        Some((cursor, word)) if order_word(order) == word => Ok(Some(cursor)),
        Some((_, word)) => Err(Problem::invalid(
            "cursor",
            format!("is of a page with `order={word}`; send it with that order"),
        )),
        None => Err(Problem::invalid("cursor", "must be the `next` of a previous page")),
    }
}

/// Word of an order in requests and cursors.
const fn order_word(order: EpisodeSortOrder) -> &'static str {
    match order {
        EpisodeSortOrder::Newest => "newest",
        EpisodeSortOrder::Oldest => "oldest",
        EpisodeSortOrder::WorstScore => "worst_score",
        EpisodeSortOrder::BestScore => "best_score",
        EpisodeSortOrder::WorstSkill => "worst_skill",
        EpisodeSortOrder::BestSkill => "best_skill",
    }
}

const fn stored_order(order: EpisodeSortOrder) -> EpisodeOrder {
    const fn by(value: OrderValue, descending: bool) -> EpisodeOrder {
        EpisodeOrder::ByValue { value, descending }
    }
    match order {
        EpisodeSortOrder::Newest => EpisodeOrder::Newest,
        EpisodeSortOrder::Oldest => EpisodeOrder::Oldest,
        EpisodeSortOrder::WorstScore => by(OrderValue::Score, false),
        EpisodeSortOrder::BestScore => by(OrderValue::Score, true),
        EpisodeSortOrder::WorstSkill => by(OrderValue::Skill, false),
        EpisodeSortOrder::BestSkill => by(OrderValue::Skill, true),
    }
}

const fn stored_state(state: EpisodeStateFilter) -> EpisodeState {
    match state {
        EpisodeStateFilter::Finished => EpisodeState::Finished,
        EpisodeStateFilter::Failed => EpisodeState::Failed,
        EpisodeStateFilter::Late => EpisodeState::Late,
    }
}
