//! `/v1`: one file per resource.

mod audit;
mod columns;
mod critique;
mod designs;
mod episode_list;
mod episode_search;
mod episodes;
mod evaluations;
mod events;
mod failure_list;
mod failures;
mod flights;
mod layouts;
mod leases;
mod mastery;
mod overview;
mod policy;
mod results;
mod retention;
mod run_change;
mod run_settings;
mod runs;
mod scenarios;
mod series;
mod sessions;
mod strategies;
mod suites;
mod tasks;
mod trajectories;
mod versions;

use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::problem::Problem;
use crate::ids::RunId;
use crate::http::state::AppState;

pub(super) fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(runs::create, runs::list))
        .routes(routes!(runs::show, run_change::change))
        .routes(routes!(runs::pause))
        .routes(routes!(runs::archive))
        .routes(routes!(runs::resume))
        .routes(routes!(runs::set_newest))
        .routes(routes!(retention::put))
        .routes(routes!(versions::list))
        .routes(routes!(versions::put))
        .routes(routes!(leases::take::take, leases::list::list))
        .routes(routes!(leases::show::show))
        .routes(routes!(leases::renew::renew))
        .routes(routes!(leases::release::release))
        .routes(routes!(results::report))
        .routes(routes!(columns::claim, columns::show))
        .routes(routes!(columns::entries))
        .routes(routes!(events::listen))
        .routes(routes!(mastery::show))
        .routes(routes!(mastery::history))
        .routes(routes!(mastery::params))
        .routes(routes!(series::show))
        .routes(routes!(overview::show))
        .routes(routes!(run_settings::list))
        .routes(routes!(episode_list::list))
        .routes(routes!(episode_search::search))
        .routes(routes!(episodes::show))
        .routes(routes!(episodes::replayed))
        .routes(routes!(critique::show))
        .routes(routes!(failures::show))
        .routes(routes!(failure_list::list))
        .routes(routes!(designs::list::list, designs::ask::ask))
        .routes(routes!(designs::asks::list))
        .routes(routes!(designs::asks::show))
        .routes(routes!(designs::summary::show))
        .routes(routes!(designs::show::show))
        .routes(routes!(designs::turn::retire))
        .routes(routes!(designs::turn::revive))
        .routes(routes!(layouts::list))
        .routes(routes!(layouts::show))
        .routes(routes!(scenarios::check))
        .routes(routes!(flights::fly))
        .routes(routes!(sessions::connect))
        .routes(routes!(policy::show, policy::put))
        .routes(routes!(trajectories::pull::pull))
        .routes(routes!(trajectories::ack::ack))
        .routes(routes!(tasks::list))
        .routes(routes!(strategies::list))
        .routes(routes!(evaluations::list::list, evaluations::begin::begin))
        .routes(routes!(evaluations::compare::compare))
        .routes(routes!(evaluations::show::show))
        .routes(routes!(evaluations::cancel::cancel))
        .routes(routes!(evaluations::scenarios::list))
        .routes(routes!(suites::list))
        .routes(routes!(audit::list))
}

/// Parses a run's id from a path.
fn run_id(text: &str) -> Result<RunId, Problem> {
    text.parse().map_err(|error: crate::ids::InvalidId| {
        Problem::new(axum::http::StatusCode::BAD_REQUEST, "bad_id", error.to_string()).at("run")
    })
}

/// A connection that reads, where the run exists.
async fn reader_of(app: &AppState, run: &RunId) -> Result<sqlx::pool::PoolConnection<sqlx::Sqlite>, Problem> {
    let mut conn = app.readers.acquire().await?;
    match crate::store::runs::get(&mut conn, run.as_str()).await? {
        Some(_) => Ok(conn),
        None => Err(crate::engine::error::ServiceError::UnknownRun(run.to_string()).into()),
    }
}

/// Parses any id from a path.
fn id<T: std::str::FromStr<Err = crate::ids::InvalidId>>(field: &str, text: &str) -> Result<T, Problem> {
    text.parse().map_err(|error: crate::ids::InvalidId| {
        Problem::new(axum::http::StatusCode::BAD_REQUEST, "bad_id", error.to_string()).at(field)
    })
}

/// How many a list gives at most, and where it goes on.
#[derive(Debug, serde::Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
struct Page {
    /// How many at most: 1 to 500 (50).
    limit: Option<u32>,
    /// `next` of the page before.
    cursor: Option<String>,
}

impl Page {
    fn limit(&self) -> Result<i64, Problem> {
        match self.limit.unwrap_or(50) {
            limit @ 1..=500 => Ok(i64::from(limit)),
            limit => Err(Problem::invalid("limit", format!("it is {limit}, outside 1 to 500"))),
        }
    }

    /// The cursor as (number, text), `0` and empty at the start.
    fn cursor(&self) -> Result<(i64, &str), Problem> {
        let Some(cursor) = &self.cursor else { return Ok((0, "")) };
        cursor
            .split_once('.')
            .and_then(|(number, text)| Some((number.parse().ok()?, text)))
            .ok_or_else(|| Problem::invalid("cursor", "it is not one that a list gave"))
    }
}

/// The cursor after a row, where a full page says that there may be more.
fn next(rows: usize, limit: i64, last: Option<(i64, &str)>) -> Option<String> {
    last.filter(|_| rows as i64 >= limit).map(|(number, text)| format!("{number}.{text}"))
}
