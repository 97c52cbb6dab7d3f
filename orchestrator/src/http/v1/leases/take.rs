//! Taking a lease.

use axum::Extension;
use axum::extract::State;
use axum::http::StatusCode;
use serde::Deserialize;
use utoipa::ToSchema;

use super::super::super::access::Caller;
use super::super::super::extract::{Json, NoQuery, Path};
use super::super::super::problem::Problem;
use super::super::run_id;
use super::view::{Lease, describe, described};
use crate::ids::EvaluationId;
use crate::http::state::AppState;
use crate::leases::columns::CreateColumnLease;
use crate::store::leases::Purpose;
use crate::leases::create::{CreateLease, GrantedLease};

/// A lease as it is asked for.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::http::v1) struct LeaseWish {
    /// How many groups: 1 to 1 024; with `form: columns` 1 to 100 000.
    groups: u32,
    /// Episodes of one scenario in each (the run's group_size).
    group_size: Option<u32>,
    /// The policy that will fly it (0).
    #[serde(default)]
    policy_version: u32,
    /// How long it holds, seconds: 1 to 86 400 (600).
    #[serde(default = "ten_minutes")]
    ttl_s: u32,
    /// `train` (default), `probe` or `eval`.
    #[serde(default = "train")]
    purpose: Purpose,
    /// `groups` (default): every group with its scenario and bracket, every log replayed. `columns`: for 10⁵ episodes and more a
    /// second: ranges of seeds, as they come, without brackets; results are columns, of which some groups are audited.
    #[serde(default)]
    form: Form,
    /// Whether groups whose episodes all have the same score are replaced, up to as many as were asked for (false). The answer to
    /// their results names the groups that came in their place.
    #[serde(default)]
    refill: bool,
    /// With `purpose: eval`: the evaluation whose scenarios are wanted, of those that nobody flies. As many groups are answered as there
    /// are, at most as many as were asked for.
    evaluation: Option<String>,
}

/// How a lease's episodes are named and reported.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
enum Form {
    #[default]
    Groups,
    Columns,
}

const fn ten_minutes() -> u32 {
    600
}

const fn train() -> Purpose {
    Purpose::Train
}

/// Lease groups of scenarios. Where scenarios are still being prepared it waits a while, then answers 503.
#[utoipa::path(
    post, path = "/runs/{run}/leases", tag = "leases", request_body = LeaseWish,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 201, body = Lease),
        (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The run is paused."), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem), (status = 429, body = Problem),
        (status = 503, body = Problem, description = "Scenarios are still being prepared; see Retry-After.")
    )
)]
pub(in crate::http::v1) async fn take(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    Json(wish): Json<LeaseWish>,
) -> Result<(StatusCode, axum::Json<Lease>), Problem> {
    let LeaseWish { groups, group_size, policy_version, ttl_s, purpose, form, refill, evaluation } = wish;
    let (run, owner) = (run_id(&run)?, caller.owns(app.each.leases));
    let evaluation = evaluation.map(|text| text.parse::<EvaluationId>()).transpose();
    let evaluation =
        evaluation.map_err(|error| Problem::invalid("evaluation", error.to_string()))?.map(|id| id.0);
    let wish = CreateLease {
        run: run.clone(),
        groups,
        group_size,
        policy_version,
        ttl_s,
        purpose,
        owner,
        refill,
        evaluation,
    };
    let GrantedLease { row, groups, scenarios } = match form {
        Form::Groups => app.desk.lease(wish).await?,
        Form::Columns => app.writer.change(CreateColumnLease(wish)).await?,
    };
    let lease = match scenarios {
        Some(scenarios) => described(row, groups, &scenarios)?,
        None => describe(&mut *app.readers.acquire().await?, row, groups).await?,
    };
    Ok((StatusCode::CREATED, axum::Json(lease)))
}
