//! Versions of a run's policy: what they are, and how they fared.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::super::extract::{Json, NoQuery, Path, Query};
use super::super::problem::Problem;
use super::{Page, next, reader_of, run_id};
use crate::clock::rfc3339;
use crate::http::state::AppState;
use crate::store::runs;
use crate::store::policy_versions::{self, PolicyVersionRow, VersionResult};
use crate::runs::policy_version::{DescribeVersion, VersionRequest};

/// A version of a run's policy.
#[derive(Serialize, ToSchema)]
pub(super) struct Version {
    /// The version.
    version: i64,
    /// Versions between it and the newest.
    staleness: i64,
    /// Where its weights are, as it was told.
    checkpoint: Option<String>,
    /// Whatever else was told.
    notes: Option<String>,
    /// When it was told of, RFC 3339; none of what only came with results.
    told_at: Option<String>,
    /// How it fared, task by task: over all episodes but evaluations, contested or not.
    tasks: Vec<VersionTask>,
}

/// How a version fared on a task.
#[derive(Serialize, ToSchema)]
struct VersionTask {
    /// The task.
    task: String,
    /// Episodes that finished.
    episodes: i64,
    /// Of these, successes.
    successes: i64,
    /// successes / episodes.
    success: f64,
    /// Mean score.
    score: f64,
    /// When the first came in, RFC 3339.
    first_at: String,
    /// When the last did, RFC 3339.
    last_at: String,
}

impl From<VersionResult> for VersionTask {
    fn from(sums: VersionResult) -> Self {
        let VersionResult { task, episodes, successes, score, first_at, last_at, .. } = sums;
        let over = episodes.max(1) as f64;
        Self {
            task,
            episodes,
            successes,
            success: successes as f64 / over,
            score: score / over,
            first_at: rfc3339(first_at),
            last_at: rfc3339(last_at),
        }
    }
}

/// A page of versions.
#[derive(Serialize, ToSchema)]
pub(super) struct Versions {
    /// The newest first.
    versions: Vec<Version>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

fn version(number: i64, newest: i64, told: Option<PolicyVersionRow>, sums: Vec<VersionResult>) -> Version {
    let told_at = told.as_ref().map(|row| rfc3339(row.at));
    let (checkpoint, notes) = told.map_or((None, None), |row| (row.checkpoint, row.notes));
    let tasks = sums.into_iter().map(VersionTask::from).collect();
    Version { version: number, staleness: (newest - number).max(0), checkpoint, notes, told_at, tasks }
}

/// List the versions of a run's policy, the newest first: those that were told of, and those that results came from. Of very many
/// that were never told of the newest are kept.
#[utoipa::path(
    get, path = "/runs/{run}/versions", tag = "runs",
    params(("run" = String, Path, description = "The run's id."), Page),
    responses(
        (status = 200, body = Versions), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn list(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(page): Query<Page>,
) -> Result<axum::Json<Versions>, Problem> {
    let (run, limit) = (run_id(&run)?, page.limit()?);
    let before = if page.cursor.is_some() { page.cursor()?.0 } else { i64::MAX };
    let mut conn = reader_of(&app, &run).await?;
    let newest = runs::get(&mut conn, run.as_str()).await?.map_or(0, |row| row.policy_version);
    let numbers = policy_versions::known(&mut conn, run.as_str(), before, limit).await?;
    let (from, to) = (numbers.last().copied().unwrap_or(0), numbers.first().copied().unwrap_or(0));
    let told = policy_versions::descriptions(&mut conn, run.as_str(), from, to).await?;
    let sums = policy_versions::results(&mut conn, run.as_str(), from, to).await?;
    let next = next(numbers.len(), limit, numbers.last().map(|number| (*number, "")));
    let of = |number: &i64| {
        let told = told.iter().find(|row| row.version == *number).cloned();
        let sums = sums.iter().filter(|sums| sums.version == *number).cloned().collect();
        version(*number, newest, told, sums)
    };
    Ok(axum::Json(Versions { versions: numbers.iter().map(of).collect(), next }))
}

/// Tell of a version of the run's policy: where its weights are, and what else should be known. Telling again replaces what was
/// told. A version above the newest is the newest from then on.
#[utoipa::path(
    put, path = "/runs/{run}/versions/{version}", tag = "runs", request_body = VersionRequest,
    params(
        ("run" = String, Path, description = "The run's id."), ("version" = u32, Path, description = "The version.")
    ),
    responses(
        (status = 200, body = Version), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn put(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, number)): Path<(String, String)>,
    Json(wish): Json<VersionRequest>,
) -> Result<axum::Json<Version>, Problem> {
    let run = run_id(&run)?;
    let number: u32 = number.parse().map_err(|_| {
        Problem::invalid("version", format!("it must be a whole number from 0 to {}", u32::MAX))
    })?;
    app.writer.change(DescribeVersion::read(run.clone(), number, wish)?).await?;
    let mut conn = reader_of(&app, &run).await?;
    let (name, number) = (run.as_str(), i64::from(number));
    let newest = runs::get(&mut conn, name).await?.map_or(0, |row| row.policy_version);
    let told = policy_versions::get(&mut conn, name, number).await?;
    let sums = policy_versions::results(&mut conn, name, number, number).await?;
    Ok(axum::Json(version(number, newest, told, sums)))
}
