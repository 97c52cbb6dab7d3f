//! Columns: results of all episodes of a lease in one request, and their audit.

use api_types::{AuditedGroup, ClaimedColumns, ColumnClaim};
use axum::extract::{Request, State};
use serde::Deserialize;
use utoipa::ToSchema;

use super::super::blocking::run_blocking;
use super::super::extract::{EncodedBody, NoQuery, Path};
use super::super::large_body::{LargeBody, receive_large_body};
use super::super::number_column::{NumberColumn, optional_u32, parse_columns};
use super::super::problem::Problem;
use super::{parse_id, run_id};
use crate::clock::rfc3339;
use crate::engine::error::ServiceError;
use crate::http::state::AppState;
use crate::ids::{EpisodeId, LeaseId};
use crate::leases::find::find_lease;
use crate::results::columns::claim as column_claims;
use crate::results::columns::status::{self, ClaimStatus};
use crate::results::columns::table::Columns;
use crate::store::leases::LeaseRow;

/// Columns with one entry for each episode of the lease, in order. In MessagePack a column may also be `bin`: packed little-endian.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct ColumnsRequest {
    /// Policy version that ran the episodes (default: the lease's).
    #[serde(default, deserialize_with = "policy_version")]
    policy_version: Option<u32>,
    /// Score of each episode; a number is required for failed episodes too and ignored. `bin`: f32.
    #[schema(value_type = Vec<f32>)]
    #[serde(deserialize_with = "score")]
    score: NumberColumn<f32>,
    /// 1 for each episode that the infrastructure lost, else 0; optional if none was lost. `bin`: u8.
    #[schema(value_type = Option<Vec<u8>>)]
    #[serde(default, deserialize_with = "failed")]
    failed: NumberColumn<u8>,
    /// Number of steps of each episode; optional. `bin`: u32.
    #[schema(value_type = Option<Vec<u32>>)]
    #[serde(default, deserialize_with = "steps")]
    steps: NumberColumn<u32>,
}

/// Defines a deserializer of a column whose errors name the field.
macro_rules! named_column {
    ($name:ident, $of:ty) => {
        fn $name<'de, D: serde::Deserializer<'de>>(reader: D) -> Result<NumberColumn<$of>, D::Error> {
            NumberColumn::deserialize(reader)
                .map_err(|error| super::super::number_column::field_error(stringify!($name), error))
        }
    };
}
named_column!(score, f32);
named_column!(failed, u8);
named_column!(steps, u32);

fn policy_version<'de, D: serde::Deserializer<'de>>(reader: D) -> Result<Option<u32>, D::Error> {
    optional_u32(reader).map_err(|error| super::super::number_column::field_error("policy_version", error))
}

/// Converts a claim and groups its audited episodes.
fn claim_from_status(status: ClaimStatus) -> ColumnClaim {
    let ClaimStatus { claim, lease, audited } = status;
    let LeaseRow { group_size, .. } = lease;
    let id = LeaseId { number: lease.id, token: lease.token };
    let mut audit: Vec<AuditedGroup> = Vec::new();
    for index in audited {
        let group = index / group_size.max(1);
        let episode = EpisodeId { lease: id.clone(), index }.to_string();
        match audit.last_mut().filter(|last| last.group == group) {
            Some(last) => {
                last.entries.push(index);
                last.episodes.push(episode);
            }
            None => audit.push(AuditedGroup { group, entries: vec![index], episodes: vec![episode] }),
        }
    }
    ColumnClaim {
        audit,
        lease: id.to_string(),
        state: claim.state.to_string(),
        episodes: claim.episodes,
        failed: claim.failed,
        policy_version: claim.policy_version,
        why: claim.why,
        due: rfc3339(lease.expires_at),
    }
}

/// Claim the results of all episodes of a lease of columns. The response is sent after the commit and lists the audited groups. Their
/// logs are due as results before the lease expires. The claim is accepted if every replay agrees with it, and refused as a whole
/// otherwise. A repeated claim returns the same response.
#[utoipa::path(
    post, path = "/runs/{run}/leases/{lease}/columns", tag = "results", request_body = ColumnsRequest,
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = ColumnClaim), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The lease has ended, or it has other columns already."),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn claim_columns(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, lease)): Path<(String, String)>,
    request: Request,
) -> Result<axum::Json<ColumnClaim>, Problem> {
    let (run, lease) = (run_id(&run)?, parse_id("lease", &lease)?);
    let LargeBody { body, permit: _permit } = receive_large_body(&app.body_limit, request).await?;
    let (policy_version, columns) = run_blocking(move || read_columns(body)).await?;
    let status = column_claims::claim(&app.lease_service, run, lease, policy_version, columns).await?;
    Ok(axum::Json(claim_from_status(status)))
}

/// Reads the columns of a body and the policy version that it names.
fn read_columns(EncodedBody { format, bytes }: EncodedBody) -> Result<(Option<u32>, Columns), Problem> {
    let ColumnsRequest { policy_version, score, failed, steps } = parse_columns(format, &bytes)?;
    if let Some(at) = failed.0.iter().position(|failed| *failed > 1) {
        return Err(Problem::invalid(format!("failed.{at}"), "it is neither 0 nor 1"));
    }
    let failed = failed.0.into_iter().map(|failed| failed == 1).collect();
    Ok((policy_version, Columns { scores: score.0, failed, steps: steps.0 }))
}

/// Get the columns of a lease as they were claimed, whether accepted or not.
#[utoipa::path(
    get, path = "/runs/{run}/leases/{lease}/columns/entries", tag = "results",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = ClaimedColumns), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 410, body = Problem, description = "The run no longer keeps them.")
    )
)]
pub(super) async fn get_claimed_columns(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<ClaimedColumns>, Problem> {
    let (run, lease) = (run_id(&run)?, parse_id("lease", &lease)?);
    let mut conn = app.readers.acquire().await?;
    let row = find_lease(&mut conn, &run, &lease).await?;
    check_kept(&row)?;
    let claimed = status::claimed_columns(&mut conn, row.id).await?.ok_or_else(no_columns)?;
    let (state, Columns { scores, failed, steps }) = (claimed.state.to_string(), claimed.columns);
    let failed = failed.into_iter().map(u8::from).collect();
    Ok(axum::Json(ClaimedColumns { state, score: scores, failed, steps }))
}

/// Checks that the columns of a lease are still stored.
fn check_kept(lease: &LeaseRow) -> Result<(), Problem> {
    if !lease.is_compacted { Ok(()) } else { Err(ServiceError::Expired(lease.name()).into()) }
}

fn no_columns() -> Problem {
    Problem::new(axum::http::StatusCode::NOT_FOUND, "no_columns", "This lease has no columns.")
}

/// Get the claim of a lease and its state.
#[utoipa::path(
    get, path = "/runs/{run}/leases/{lease}/columns", tag = "results",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = ColumnClaim), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 410, body = Problem, description = "The run no longer keeps them.")
    )
)]
pub(super) async fn get_column_claim(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<ColumnClaim>, Problem> {
    let (run, lease) = (run_id(&run)?, parse_id("lease", &lease)?);
    let mut conn = app.readers.acquire().await?;
    let row = find_lease(&mut conn, &run, &lease).await?;
    check_kept(&row)?;
    Ok(axum::Json(claim_from_status(status::claim_status(&mut conn, row).await?.ok_or_else(no_columns)?)))
}
