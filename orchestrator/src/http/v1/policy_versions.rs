//! Versions of a run's policy: their descriptions and results.

use api_types::{
    PageQuery, PolicyVersion, PolicyVersionDescription, PolicyVersionPage, PolicyVersionResults,
};
use axum::Extension;
use axum::extract::State;
use store::policy_versions::{self, PolicyVersionRow, VersionResult};
use store::runs;

use crate::http::access::Caller;
use crate::http::extract::{Json, NoQuery, Path, Query};
use crate::http::paging::{PageCursor, next_cursor, number_before, page_limit};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::runs::policy_version::DescribePolicyVersion;
use clock::rfc3339;

fn version_results(sums: VersionResult) -> PolicyVersionResults {
    let VersionResult { task, episodes, successes, score_sum: score, first_at, last_at, .. } = sums;
    let finished = episodes.max(1) as f64;
    PolicyVersionResults {
        task,
        episodes,
        successes,
        success: successes as f64 / finished,
        score: score / finished,
        first_at: rfc3339(first_at),
        last_at: rfc3339(last_at),
    }
}

/// Builds a version; `newest` is the newest version of the run.
fn policy_version(
    version: i64,
    newest: i64,
    description: Option<PolicyVersionRow>,
    results: Vec<VersionResult>,
) -> PolicyVersion {
    let told_at = description.as_ref().map(|row| rfc3339(row.at));
    let (checkpoint, notes) = description.map_or((None, None), |row| (row.checkpoint, row.notes));
    let tasks = results.into_iter().map(version_results).collect();
    PolicyVersion {
        version,
        staleness: (newest - version).max(0),
        checkpoint,
        notes,
        described_at: told_at,
        tasks,
    }
}

/// List the policy versions of a run, newest first.
///
/// The list has versions with a description and versions with results. Only the newest versions without a description are kept.
#[utoipa::path(
    get, path = "/runs/{run}/policy_versions", tag = "runs",
    params(("run" = String, Path, description = "The run's id."), PageQuery),
    responses(
        (status = 200, body = PolicyVersionPage), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn list_policy_versions(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<PolicyVersionPage>, Problem> {
    let (run, limit) = (parse_run_id(&run)?, page_limit(page.limit)?);
    let before = number_before(page.cursor.as_deref())?;
    let mut conn = acquire_run_reader(&app, &run).await?;
    let newest = runs::get(&mut conn, run.as_str()).await?.map_or(0, |row| row.policy_version);
    let numbers = policy_versions::known(&mut conn, run.as_str(), before, limit).await?;
    let (from, to) = (numbers.last().copied().unwrap_or(0), numbers.first().copied().unwrap_or(0));
    let description = policy_versions::descriptions(&mut conn, run.as_str(), from, to).await?;
    let sums = policy_versions::results(&mut conn, run.as_str(), from, to).await?;
    let next = next_cursor(numbers.len(), limit, numbers.last().map(|number| PageCursor::at(*number)));
    let of = |number: &i64| {
        let description = description.iter().find(|row| row.version == *number).cloned();
        let sums = sums.iter().filter(|sums| sums.version == *number).cloned().collect();
        policy_version(*number, newest, description, sums)
    };
    Ok(axum::Json(PolicyVersionPage { versions: numbers.iter().map(of).collect(), next }))
}

/// Describe a policy version of a run: the location of its weights, and notes.
///
/// A new description replaces the old one. A version above the newest becomes the newest. A version more than 1 000 000 above it is
/// rejected, unless an admin sends it.
#[utoipa::path(
    put, path = "/runs/{run}/policy_versions/{version}", tag = "runs", request_body = PolicyVersionDescription,
    params(
        ("run" = String, Path, description = "The run's id."), ("version" = u32, Path, description = "The version.")
    ),
    responses(
        (status = 200, body = PolicyVersion), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn describe_policy_version(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path((run, number)): Path<(String, String)>,
    Json(request): Json<PolicyVersionDescription>,
) -> Result<axum::Json<PolicyVersion>, Problem> {
    let run = parse_run_id(&run)?;
    let number: u32 = number
        .parse()
        .map_err(|_| Problem::invalid("version", format!("must be an integer from 0 to {}", u32::MAX)))?;
    let change = DescribePolicyVersion::from_request(run.clone(), number, caller.actor(), request)?;
    app.writer.change(change).await?;
    let mut conn = acquire_run_reader(&app, &run).await?;
    let (name, number) = (run.as_str(), i64::from(number));
    let newest = runs::get(&mut conn, name).await?.map_or(0, |row| row.policy_version);
    let description = policy_versions::get(&mut conn, name, number).await?;
    let sums = policy_versions::results(&mut conn, name, number, number).await?;
    Ok(axum::Json(policy_version(number, newest, description, sums)))
}
