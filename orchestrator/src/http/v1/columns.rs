//! Columns: results of all episodes of a lease in one request, and their audit.

use crate::api_enums::ConvertEnum;
use api_types::{AuditedGroup, ClaimedColumns, ColumnClaim, ColumnsRequest};
use axum::Extension;
use axum::extract::{Request, State};
use serde::Deserialize;
use store::ids::{EpisodeId, LeaseId};
use store::leases::LeaseRow;

use crate::engine::error::ServiceError;
use crate::http::access::Caller;
use crate::http::blocking::run_blocking;
use crate::http::extract::{EncodedBody, NoQuery, Path};
use crate::http::large_body::{LargeBody, receive_large_body};
use crate::http::number_column::{NumberColumn, optional_u32, parse_columns};
use crate::http::path_ids::{parse_id, parse_run_id};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::leases::find::find_own_lease;
use crate::results::columns::claim as column_claims;
use crate::results::columns::status::{self, ClaimStatus};
use crate::results::columns::table::Columns;
use crate::trainer_activity::TrainerWork;
use clock::rfc3339;

/// Body of a claim, which may have packed columns. Its JSON is that of [`ColumnsRequest`].
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ColumnsBody {
    #[serde(default, deserialize_with = "policy_version")]
    policy_version: Option<u32>,
    #[serde(deserialize_with = "score")]
    score: NumberColumn<f32>,
    #[serde(default, deserialize_with = "failed")]
    failed: NumberColumn<u8>,
    #[serde(default, deserialize_with = "steps")]
    steps: NumberColumn<u32>,
}

/// Defines a deserializer of a column whose errors name the field.
macro_rules! named_column {
    ($name:ident, $of:ty) => {
        fn $name<'de, D: serde::Deserializer<'de>>(reader: D) -> Result<NumberColumn<$of>, D::Error> {
            NumberColumn::deserialize(reader)
                .map_err(|error| crate::http::number_column::field_error(stringify!($name), error))
        }
    };
}
named_column!(score, f32);
named_column!(failed, u8);
named_column!(steps, u32);

fn policy_version<'de, D: serde::Deserializer<'de>>(reader: D) -> Result<Option<u32>, D::Error> {
    optional_u32(reader).map_err(|error| crate::http::number_column::field_error("policy_version", error))
}

/// Converts a claim and groups its audited episodes.
fn claim_from_status(status: ClaimStatus) -> ColumnClaim {
    let ClaimStatus { claim, lease, audited } = status;
    let LeaseRow { group_size, .. } = lease;
    let id = LeaseId { number: lease.id, suffix: lease.id_suffix };
    let mut audited_groups: Vec<AuditedGroup> = Vec::new();
    for index in audited {
        let group = index / group_size.max(1);
        let episode = EpisodeId { lease: id.clone(), index }.to_string();
        match audited_groups.last_mut().filter(|last| last.group == group) {
            Some(last) => {
                last.entries.push(index);
                last.episodes.push(episode);
            }
            None => {
                audited_groups.push(AuditedGroup { group, entries: vec![index], episodes: vec![episode] });
            }
        }
    }
    ColumnClaim {
        audited_groups,
        lease: id.to_string(),
        state: claim.state.convert(),
        episodes: claim.episodes,
        failed: claim.failed,
        policy_version: claim.policy_version,
        reason: claim.refusal_reason,
        due_at: rfc3339(lease.expires_at),
    }
}

/// Claim the results of all episodes of a lease of columns.
///
/// The server responds after the commit with the audited groups. The trainer must report their logs as results before the lease
/// expires. The claim is accepted if every replay agrees with it, otherwise it is refused as a whole. A repeated claim returns the
/// same response.
#[utoipa::path(
    post, path = "/runs/{run}/leases/{lease}/columns", tag = "results", request_body = ColumnsRequest,
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = ColumnClaim), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The lease has ended, or already has different columns."),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn claim_columns(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path((run, lease)): Path<(String, String)>,
    request: Request,
) -> Result<(Extension<TrainerWork>, axum::Json<ColumnClaim>), Problem> {
    let (run, lease) = (parse_run_id(&run)?, parse_id("lease", &lease)?);
    let LargeBody { body, permit: _permit } = receive_large_body(&app.body_limit, request).await?;
    let (policy_version, columns) = run_blocking(move || read_columns(body)).await?;
    let actor = caller.actor();
    let status = column_claims::claim(&app.lease_service, run, lease, actor, policy_version, columns).await?;
    let claim = claim_from_status(status);
    let work = TrainerWork {
        episodes: u64::try_from(claim.episodes).unwrap_or(0),
        policy_version: Some(claim.policy_version),
        ..TrainerWork::default()
    };
    Ok((Extension(work), axum::Json(claim)))
}

/// Reads the columns of a body and the policy version that it names.
pub(in crate::http) fn read_columns(
    EncodedBody { format, bytes, .. }: EncodedBody,
) -> Result<(Option<u32>, Columns), Problem> {
    let ColumnsBody { policy_version, score, failed, steps } = parse_columns(format, &bytes)?;
    if let Some(at) = failed.0.iter().position(|failed| *failed > 1) {
        return Err(Problem::invalid(format!("failed.{at}"), "must be 0 or 1"));
    }
    let failed = failed.0.into_iter().map(|failed| failed == 1).collect();
    Ok((policy_version, Columns { scores: score.0, failed, steps: steps.0 }))
}

/// Get the claimed columns of a lease, whether accepted or not.
#[utoipa::path(
    get, path = "/runs/{run}/leases/{lease}/columns/entries", tag = "results",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = ClaimedColumns), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 410, body = Problem, description = "The columns were deleted when the lease was compacted.")
    )
)]
pub(super) async fn get_claimed_columns(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<ClaimedColumns>, Problem> {
    let (run, lease) = (parse_run_id(&run)?, parse_id("lease", &lease)?);
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let row = find_own_lease(&mut conn, &run, &lease, caller.actor()).await?;
    check_kept(&row)?;
    let claimed = status::claimed_columns(&mut conn, row.id).await?.ok_or_else(no_columns)?;
    let (state, Columns { scores, failed, steps }) = (claimed.state.convert(), claimed.columns);
    let failed = failed.into_iter().map(u8::from).collect();
    Ok(axum::Json(ClaimedColumns { state, score: scores, failed, steps }))
}

/// Checks that the columns of a lease are still stored.
fn check_kept(lease: &LeaseRow) -> Result<(), Problem> {
    if !lease.is_compacted { Ok(()) } else { Err(ServiceError::Expired(lease.name()).into()) }
}

fn no_columns() -> Problem {
    Problem::new(axum::http::StatusCode::NOT_FOUND, "no_columns", "the lease has no columns")
}

/// Get the claim of a lease and its state.
#[utoipa::path(
    get, path = "/runs/{run}/leases/{lease}/columns", tag = "results",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = ColumnClaim), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 410, body = Problem, description = "The columns were deleted when the lease was compacted.")
    )
)]
pub(super) async fn get_column_claim(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<ColumnClaim>, Problem> {
    let (run, lease) = (parse_run_id(&run)?, parse_id("lease", &lease)?);
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let row = find_own_lease(&mut conn, &run, &lease, caller.actor()).await?;
    check_kept(&row)?;
    Ok(axum::Json(claim_from_status(status::claim_status(&mut conn, row).await?.ok_or_else(no_columns)?)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::extract::{BodyClass, BodyFormat};

    #[test]
    fn request_of_the_api_is_read_whole() {
        let request = ColumnsRequest {
            policy_version: Some(3),
            score: vec![0.25, 0.5],
            failed: vec![0, 1],
            steps: vec![7, 8],
        };
        let bytes = serde_json::to_vec(&request).expect("a request has a JSON form").into();
        let read = read_columns(EncodedBody { format: BodyFormat::Json, bytes, class: BodyClass::Bulk });
        let (policy_version, columns) = read.map_err(|problem| problem.message()).expect("the body is valid");
        assert_eq!(policy_version, request.policy_version);
        let Columns { scores, failed, steps } = columns;
        assert_eq!((scores, failed, steps), (request.score, vec![false, true], request.steps));
    }
}
