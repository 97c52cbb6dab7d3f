//! Creation of a lease.

use crate::api_enums::ConvertEnum;
use api_types::{Lease, LeaseForm, LeaseRequest};
use axum::Extension;
use axum::extract::State;
use axum::http::StatusCode;
use store::ids::EvaluationId;

use super::view::{lease_from_cache, load_lease};
use crate::http::access::Caller;
use crate::http::extract::{Json, NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::leases::create::{CreateLease, GrantedLease};
use crate::trainer_activity::TrainerWork;

/// Create a lease of groups of scenarios.
///
/// If the scenarios are not prepared yet, the server waits for up to 10 s and then returns 503.
#[utoipa::path(
    post, path = "/runs/{run}/leases", tag = "leases", request_body = LeaseRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 201, body = Lease),
        (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The run is paused; resume it to create leases."), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem), (status = 429, body = Problem),
        (status = 503, body = Problem, description = "The scenarios are not prepared yet; retry after `Retry-After`.")
    )
)]
pub(in crate::http::v1) async fn create_lease(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    Json(request): Json<LeaseRequest>,
) -> Result<(StatusCode, Extension<TrainerWork>, axum::Json<Lease>), Problem> {
    let LeaseRequest {
        groups,
        group_size,
        policy_version,
        ttl_s,
        purpose,
        form,
        refill,
        evaluation,
        disclosure,
    } = request;
    let (run, owner) = (parse_run_id(&run)?, caller.owner_quota(app.client_limits.leases));
    let evaluation = evaluation.map(|text| text.parse::<EvaluationId>()).transpose();
    let evaluation =
        evaluation.map_err(|error| Problem::invalid("evaluation", error.to_string()))?.map(|id| id.number);
    let lease = CreateLease {
        run: run.clone(),
        groups,
        group_size,
        policy_version,
        ttl_s,
        purpose: purpose.convert(),
        owner,
        refill,
        evaluation,
        disclosure: disclosure.convert(),
    };
    let GrantedLease { row, groups, scenarios } = match form {
        LeaseForm::Groups => app.lease_service.lease(lease).await?,
        LeaseForm::Columns => app.lease_service.lease_columns(lease).await?,
    };
    let lease = match scenarios {
        Some(scenarios) => lease_from_cache(row, groups, &scenarios)?,
        None => load_lease(&mut *app.readers.acquire().await?, row, groups).await?,
    };
    let work =
        TrainerWork { leases: 1, policy_version: Some(policy_version.into()), ..TrainerWork::default() };
    Ok((StatusCode::CREATED, Extension(work), axum::Json(lease)))
}
