//! Handlers of `/v1`, one file or folder for each resource.
//!
//! A handler parses the request, calls one use case or one read model, and maps the result to a type of the `api-types` crate. The
//! name of a handler is its `operationId`. Rules and SQL are not here. Start reading at `routes`.

mod audit_log;
mod columns;
mod designs;
mod episode_critique;
mod episode_list;
mod episode_search;
mod episodes;
mod evaluations;
mod events;
mod failure_list;
mod failures;
mod layouts;
mod leases;
mod mastery;
mod overview;
mod policy;
mod policy_versions;
mod results;
mod retention;
mod rollout;
mod run_settings;
mod run_update;
mod runs;
mod scenarios;
mod series;
mod sessions;
mod strategies;
mod suites;
mod tasks;
mod trajectories;

use axum::http::StatusCode;
use sqlx::Sqlite;
use sqlx::pool::PoolConnection;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::problem::Problem;
use crate::engine::error::ServiceError;
use crate::http::state::AppState;
use crate::ids::{InvalidId, RunId};

pub(super) fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(runs::create_run, runs::list_runs))
        .routes(routes!(runs::get_run, run_update::update_run))
        .routes(routes!(runs::pause_run))
        .routes(routes!(runs::archive_run))
        .routes(routes!(runs::resume_run))
        .routes(routes!(runs::set_policy_version))
        .routes(routes!(retention::set_retention))
        .routes(routes!(policy_versions::list_policy_versions))
        .routes(routes!(policy_versions::describe_policy_version))
        .routes(routes!(leases::create::create_lease, leases::list::list_leases))
        .routes(routes!(leases::get::get_lease))
        .routes(routes!(leases::renew::renew_lease))
        .routes(routes!(leases::release::release_lease))
        .routes(routes!(results::report_results))
        .routes(routes!(columns::claim_columns, columns::get_column_claim))
        .routes(routes!(columns::get_claimed_columns))
        .routes(routes!(events::stream_events))
        .routes(routes!(mastery::get_mastery))
        .routes(routes!(mastery::list_level_moves))
        .routes(routes!(mastery::get_params))
        .routes(routes!(series::get_series))
        .routes(routes!(overview::get_overview))
        .routes(routes!(run_settings::list_run_settings))
        .routes(routes!(episode_list::list_episodes))
        .routes(routes!(episode_search::search_episodes))
        .routes(routes!(episodes::get_episode))
        .routes(routes!(episodes::replay_episode))
        .routes(routes!(episode_critique::get_episode_critique))
        .routes(routes!(failures::get_failure_profiles))
        .routes(routes!(failure_list::list_failures))
        .routes(routes!(designs::list::list_designs, designs::create_request::create_design_request))
        .routes(routes!(designs::requests::list_design_requests))
        .routes(routes!(designs::requests::get_design_request))
        .routes(routes!(designs::statistics::get_design_statistics))
        .routes(routes!(designs::get::get_design))
        .routes(routes!(designs::retire::retire_design))
        .routes(routes!(designs::retire::revive_design))
        .routes(routes!(layouts::list_layouts))
        .routes(routes!(layouts::get_layout))
        .routes(routes!(scenarios::check_scenario))
        .routes(routes!(rollout::roll_out_scenario))
        .routes(routes!(sessions::connect_session))
        .routes(routes!(policy::get_policy, policy::set_policy))
        .routes(routes!(trajectories::pull::pull_trajectories))
        .routes(routes!(trajectories::acknowledge::acknowledge_trajectories))
        .routes(routes!(tasks::list_tasks))
        .routes(routes!(strategies::list_strategies))
        .routes(routes!(evaluations::list::list_evaluations, evaluations::create::create_evaluation))
        .routes(routes!(evaluations::compare::compare_evaluations))
        .routes(routes!(evaluations::get::get_evaluation))
        .routes(routes!(evaluations::cancel::cancel_evaluation))
        .routes(routes!(evaluations::scenarios::list_evaluation_scenarios))
        .routes(routes!(suites::list_suites))
        .routes(routes!(audit_log::list_audit_log))
}

/// Parses the id of a run in a path.
fn run_id(text: &str) -> Result<RunId, Problem> {
    parse_id("run", text)
}

/// Parses an id in a path or query; `field` is its name.
fn parse_id<T: std::str::FromStr<Err = InvalidId>>(field: &str, text: &str) -> Result<T, Problem> {
    text.parse().map_err(|error: InvalidId| {
        Problem::new(StatusCode::BAD_REQUEST, "bad_id", error.to_string()).at(field)
    })
}

/// Acquires a read connection and checks that the run exists.
///
/// # Errors
/// Returns [`ServiceError::UnknownRun`] as a problem if there is no such run.
async fn reader_of_run(app: &AppState, run: &RunId) -> Result<PoolConnection<Sqlite>, Problem> {
    let mut conn = app.readers.acquire().await?;
    match crate::store::runs::get(&mut conn, run.as_str()).await? {
        Some(_) => Ok(conn),
        None => Err(ServiceError::UnknownRun(run.to_string()).into()),
    }
}

/// Checks the `limit` of a page, from 1 to 500 (default 50).
fn page_limit(limit: Option<u32>) -> Result<i64, Problem> {
    match limit.unwrap_or(50) {
        limit @ 1..=500 => Ok(i64::from(limit)),
        limit => Err(Problem::invalid("limit", format!("it is {limit}, outside 1 to 500"))),
    }
}

/// Cursor of a page, `number.text`. The default is the start of a list in ascending order.
#[derive(Debug, Clone, Copy, Default)]
struct Cursor<'a> {
    /// Number of the last row of the previous page.
    number: i64,
    /// Further key of that row; empty if the number is the whole key.
    text: &'a str,
}

impl<'a> Cursor<'a> {
    fn parse(cursor: Option<&'a str>) -> Result<Option<Self>, Problem> {
        let Some(cursor) = cursor else { return Ok(None) };
        let parts = cursor.split_once('.');
        let cursor = parts.and_then(|(number, text)| Some(Self { number: number.parse().ok()?, text }));
        cursor.map(Some).ok_or_else(|| Problem::invalid("cursor", "it is not a cursor that a list returned"))
    }
}

/// Number below which a page in descending order starts; the largest number without a cursor.
fn number_before(cursor: Option<&str>) -> Result<i64, Problem> {
    Ok(Cursor::parse(cursor)?.map_or(i64::MAX, |cursor| cursor.number))
}

/// Number above which a page in ascending order starts; −1 without a cursor.
fn number_after(cursor: Option<&str>) -> Result<i64, Problem> {
    Ok(Cursor::parse(cursor)?.map_or(-1, |cursor| cursor.number))
}

/// Formats the cursor after the last row of a page. Returns `None` if the page is not full, so that there are no more rows.
fn next_cursor(rows: usize, limit: i64, last: Option<(i64, &str)>) -> Option<String> {
    last.filter(|_| rows as i64 >= limit).map(|(number, text)| format!("{number}.{text}"))
}
