//! List of runs: search, filters, order, pages and groups.

use std::collections::BTreeSet;

use crate::api_enums::ConvertEnum;
use api_types::{RunActivity, RunGroup, RunGroupList, RunGroupQuery, RunPage, RunQuery, SortOrder};
use axum::extract::State;
use curriculum::StrategyKind;
use store::ids::RunId;
use store::run_filter::{ActivityFilter, RunFilter, TagFilter};
use store::run_list::{self, RunOrder, RunPosition, RunSortKey, RunSortValue};

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
/// change meanwhile.
#[utoipa::path(
    get, path = "/runs", tag = "runs", params(RunQuery),
    responses((status = 200, body = RunPage), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(super) async fn list_runs(
    State(app): State<AppState>,
    Query(query): Query<RunQuery>,
) -> Result<axum::Json<RunPage>, Problem> {
    let (limit, now) = (page_limit(query.limit)?, app.clock.now());
    let is_descending = query.order == Some(SortOrder::Desc);
    let order = RunOrder { key: query.sort.unwrap_or_default().convert(), is_descending };
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
    Ok(axum::Json(RunPage { runs, total, next }))
}

/// Group runs by a property.
///
/// The filters are those of `GET /v1/runs`, which lists the runs of a group with the value of the group as a filter.
#[utoipa::path(
    get, path = "/run_groups", tag = "runs", params(RunGroupQuery),
    responses((status = 200, body = RunGroupList), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(super) async fn list_run_groups(
    State(app): State<AppState>,
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
    Ok(axum::Json(RunGroupList { groups: groups.collect() }))
}

/// First part of the cursors of an order.
fn order_word(RunOrder { key, is_descending }: RunOrder) -> String {
    format!("{key}.{}", if is_descending { "desc" } else { "asc" })
}

/// Formats a cursor: `key.direction.run.value`. A real value has its bits, a missing value is empty.
fn format_cursor(order: RunOrder, position: &RunPosition) -> String {
    let value = match &position.value {
        RunSortValue::Integer(value) => value.to_string(),
        RunSortValue::Real(value) => format!("{:016x}", value.to_bits()),
        RunSortValue::Text(value) => value.clone(),
        RunSortValue::Missing => String::new(),
    };
    format!("{}.{}.{value}", order_word(order), position.id)
}

/// Parses the cursor of a page in this order.
///
/// # Errors
/// Returns a problem if the text is no cursor, or is of another order.
fn parse_cursor(order: RunOrder, cursor: &str) -> Result<RunPosition, Problem> {
    let malformed = || Problem::invalid("cursor", "must be the `next` of a previous page");
    let mut parts = cursor.splitn(4, '.');
    let mut next = || parts.next().ok_or_else(malformed);
    let (key, direction, id, value) = (next()?, next()?, next()?, next()?);
    let is_known = key.parse::<RunSortKey>().is_ok() && ["asc", "desc"].contains(&direction);
    if !is_known || id.parse::<RunId>().is_err() {
        return Err(malformed());
    }
    if format!("{key}.{direction}") != order_word(order) {
        let reason = format!("is of a page with `sort={key}&order={direction}`; send it with that order");
        return Err(Problem::invalid("cursor", reason));
    }
    let value = match order.key {
        RunSortKey::Name => Some(RunSortValue::Text(value.to_owned())),
        RunSortKey::LastResults | RunSortKey::Skill if value.is_empty() => Some(RunSortValue::Missing),
        RunSortKey::Created | RunSortKey::Episodes | RunSortKey::LastResults => {
            value.parse().ok().map(RunSortValue::Integer)
        }
        RunSortKey::Skill => {
            let real = u64::from_str_radix(value, 16).ok().map(f64::from_bits);
            real.filter(|real| real.is_finite()).map(RunSortValue::Real)
        }
    };
    Ok(RunPosition { value: value.ok_or_else(malformed)?, id: id.to_owned() })
}
