//! List of runs: search, filters, order, pages and groups.

use std::collections::BTreeSet;

use crate::api_enums::ConvertEnum;
use api_types::{RunActivity, RunGroup, RunGroupList, RunGroupQuery, RunPage, RunQuery, SortOrder};
use axum::extract::{RawQuery, State};
use axum::http::HeaderMap;
use curriculum::StrategyKind;
use store::run_filter::{ActivityFilter, RunFilter, TagFilter};
use store::run_list::{self, RunOrder};

use super::run_cursor::{format_cursor, parse_cursor};
use super::run_list_merge::{merge_groups, merge_runs};
use super::runs::{RECENT, run_from_row};
use crate::http::extract::Query;
use crate::http::filters::parse_filter_word;
use crate::http::paging::page_limit;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use clock::{Millis, rfc3339};

/// Largest number of characters of a search.
const MAX_SEARCH_CHARS: usize = 200;
/// Largest number of words of a search.
const MAX_SEARCH_WORDS: usize = 8;

/// Filters of both queries, as clients send them.
struct FilterFields {
    archived: bool,
    search: Option<String>,
    tag: Option<String>,
    strategy: Option<String>,
    tasks: Option<String>,
    activity: Option<RunActivity>,
}

impl FilterFields {
    /// Checks the filters. Results since the moment `since` make a run count as running.
    ///
    /// # Errors
    /// Returns a problem that names the first invalid field.
    fn parse(self, since: Millis) -> Result<RunFilter, Problem> {
        let activity = self.activity;
        if self.archived && activity.is_some_and(|activity| activity != RunActivity::Archived) {
            return Err(Problem::invalid("activity", "must be archived or left out with `archived=true`"));
        }
        let tag = self.tag.map(|tag| match tag.as_str() {
            "" => Ok(TagFilter::Untagged),
            tag => tag.parse().map(TagFilter::Tag).map_err(|error| {
                let error: store::run_tags::InvalidTag = error;
                Problem::invalid("tag", error.to_string())
            }),
        });
        let known = StrategyKind::ALL.map(StrategyKind::name);
        let strategy = parse_filter_word("strategy", self.strategy.as_deref(), &known)?;
        Ok(RunFilter {
            are_archived: self.archived || activity == Some(RunActivity::Archived),
            tag: tag.transpose()?,
            strategy: strategy.map(str::to_owned),
            tasks: self.tasks.as_deref().map(parse_tasks).transpose()?,
            activity: activity.map(|activity| ActivityFilter { activity: activity.convert(), since }),
            words: parse_search(self.search.as_deref().unwrap_or_default())?,
        })
    }
}

/// Returns the words of a search.
fn parse_search(search: &str) -> Result<Vec<String>, Problem> {
    let words: Vec<String> = search.split_whitespace().map(str::to_owned).collect();
    if search.chars().count() > MAX_SEARCH_CHARS || words.len() > MAX_SEARCH_WORDS {
        let limits = format!("must have at most {MAX_SEARCH_CHARS} characters and {MAX_SEARCH_WORDS} words");
        return Err(Problem::invalid("search", limits));
    }
    if search.chars().any(char::is_control) {
        return Err(Problem::invalid("search", "must have no control characters"));
    }
    Ok(words)
}

/// Returns the ids of tasks in the form of the store: in alphabetical order, separated by commas.
fn parse_tasks(tasks: &str) -> Result<String, Problem> {
    let ids: BTreeSet<&str> = tasks.split(',').map(str::trim).collect();
    match ids.iter().find(|id| env_core::task(id).is_none()) {
        Some(_) => {
            let reason = "must be ids of tasks, separated by commas; `GET /v1/tasks` lists all tasks";
            Err(Problem::invalid("tasks", reason))
        }
        None => Ok(ids.into_iter().collect::<Vec<_>>().join(",")),
    }
}

/// List runs that match a search and filters, in any order.
///
/// All filters must match. Pages are exact: while runs are created, all pages together have each run once whose sort value does not
/// change meanwhile. A server with peers (`sparring serve --peers`) lists the runs of all shards.
#[utoipa::path(
    get, path = "/runs", tag = "runs", params(RunQuery),
    responses((status = 200, body = RunPage), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(super) async fn list_runs(
    State(app): State<AppState>,
    headers: HeaderMap,
    RawQuery(raw): RawQuery,
    Query(query): Query<RunQuery>,
) -> Result<axum::Json<RunPage>, Problem> {
    let limit = page_limit(query.limit)?;
    let is_descending = query.order == Some(SortOrder::Desc);
    let order = RunOrder { key: query.sort.unwrap_or_default().convert(), is_descending };
    let own = list_own_runs(&app, query, order, limit).await?;
    let path = path_with("/v1/runs", raw);
    let peers = app.shards.ask::<RunPage>(&headers, |_| path.clone()).await;
    Ok(axum::Json(merge_runs(order, limit, own, peers)))
}

/// Reads a page of the runs of this server.
async fn list_own_runs(
    app: &AppState,
    query: RunQuery,
    order: RunOrder,
    limit: i64,
) -> Result<RunPage, Problem> {
    let now = app.clock.now();
    let after = query.cursor.as_deref().map(|cursor| parse_cursor(order, cursor)).transpose()?;
    let RunQuery { archived, search, tag, strategy, tasks, activity, .. } = query;
    let filter = FilterFields { archived, search, tag, strategy, tasks, activity }.parse(now - RECENT)?;
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let total = match after {
        None => Some(run_list::count(&mut conn, &filter).await?),
        Some(_) => None,
    };
    let page = run_list::page(&mut conn, &filter, order, after.as_ref(), limit).await?;
    let next = page.last.filter(|_| page.count >= limit).map(|last| format_cursor(order, &last));
    let runs = page.runs.into_iter().map(|row| run_from_row(row, now)).collect::<Result<_, _>>()?;
    Ok(RunPage { runs, total, next, missing_shards: Vec::new() })
}

/// Returns a path with the query of a request.
fn path_with(path: &str, query: Option<String>) -> String {
    query.map_or_else(|| path.to_owned(), |query| format!("{path}?{query}"))
}

/// Group runs by a property.
///
/// The filters are those of `GET /v1/runs`, which lists the runs of a group with the value of the group as a filter. A server with
/// peers groups the runs of all shards.
#[utoipa::path(
    get, path = "/run_groups", tag = "runs", params(RunGroupQuery),
    responses((status = 200, body = RunGroupList), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(super) async fn list_run_groups(
    State(app): State<AppState>,
    headers: HeaderMap,
    RawQuery(raw): RawQuery,
    Query(query): Query<RunGroupQuery>,
) -> Result<axum::Json<RunGroupList>, Problem> {
    let since = app.clock.now() - RECENT;
    let RunGroupQuery { by, archived, search, tag, strategy, tasks, activity } = query;
    let filter = FilterFields { archived, search, tag, strategy, tasks, activity }.parse(since)?;
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let rows = run_list::groups(&mut conn, &filter, by.convert(), since).await?;
    let groups = rows.into_iter().map(|row| RunGroup {
        value: row.value,
        runs: row.runs,
        episodes: row.episodes,
        last_results_at: row.last_results_at.map(rfc3339),
    });
    let own = RunGroupList { groups: groups.collect(), missing_shards: Vec::new() };
    drop(conn);
    let path = path_with("/v1/run_groups", raw);
    let peers = app.shards.ask::<RunGroupList>(&headers, |_| path.clone()).await;
    Ok(axum::Json(merge_groups(own, peers)))
}
