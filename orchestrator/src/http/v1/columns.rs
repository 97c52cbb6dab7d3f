//! Columns: what is claimed of all episodes of a lease at once, and what of it is audited.

use axum::extract::{Request, State};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::super::column::{Column, read, whole};
use super::super::extract::{Bytes, NoQuery, Path};
use super::super::problem::Problem;
use super::super::room::aside;
use super::{id, run_id};
use crate::clock::rfc3339;
use crate::ids::{EpisodeId, LeaseId};
use crate::http::state::AppState;
use crate::store::leases::LeaseRow;
use crate::engine::error::ServiceError;
use crate::results::columns;
use crate::results::columns::claim as store_claim;
use crate::results::columns::status::{self, ClaimStatus};
use crate::results::columns::table::Columns;
use crate::leases::find::find_lease;

/// One entry for each episode of the lease, in order. In MessagePack a column may also be `bin`: little-endian, without gaps.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct ColumnsWish {
    /// The policy that flew them (the lease's).
    #[serde(default, deserialize_with = "policy_version")]
    policy_version: Option<u32>,
    /// The score of each; of those that failed it is not looked at, but must be a number. `bin`: f32.
    #[schema(value_type = Vec<f32>)]
    #[serde(deserialize_with = "score")]
    score: Column<f32>,
    /// 1 where the infrastructure lost it, else 0; left out where none was lost. `bin`: u8.
    #[schema(value_type = Option<Vec<u8>>)]
    #[serde(default, deserialize_with = "failed")]
    failed: Column<u8>,
    /// Steps flown, if you like. `bin`: u32.
    #[schema(value_type = Option<Vec<u32>>)]
    #[serde(default, deserialize_with = "steps")]
    steps: Column<u32>,
}

macro_rules! named {
    ($name:ident, $of:ty) => {
        fn $name<'de, D: serde::Deserializer<'de>>(reader: D) -> Result<Column<$of>, D::Error> {
            Column::deserialize(reader)
                .map_err(|error| super::super::column::within(stringify!($name), error))
        }
    };
}
named!(score, f32);
named!(failed, u8);
named!(steps, u32);

fn policy_version<'de, D: serde::Deserializer<'de>>(reader: D) -> Result<Option<u32>, D::Error> {
    whole(reader).map_err(|error| super::super::column::within("policy_version", error))
}

/// A claim, and what of it is audited.
#[derive(Serialize, ToSchema)]
pub(super) struct Claim {
    /// The lease.
    lease: String,
    /// `claimed` (logs are due), `accepted`, `refused` or `unproven` (logs never came).
    state: String,
    /// Episodes claimed.
    episodes: i64,
    /// Of these, failed.
    failed: i64,
    /// The policy that flew them.
    policy_version: i64,
    /// Why it was refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    why: Option<String>,
    /// Until when the logs of what is audited are due, RFC 3339: report them as results.
    due: String,
    /// The groups whose logs are replayed.
    audit: Vec<Audit>,
}

/// A group whose logs are due.
#[derive(Serialize, ToSchema)]
struct Audit {
    /// Its number in the lease.
    group: i64,
    /// Where its episodes that finished stand in the columns.
    entries: Vec<i64>,
    /// What to report them as, one for each of these.
    episodes: Vec<String>,
}

impl Claim {
    pub(super) fn of(claimed: ClaimStatus) -> Self {
        let ClaimStatus { claim, lease, audited } = claimed;
        let LeaseRow { group_size, .. } = lease;
        let id = LeaseId { number: lease.id, token: lease.token };
        let mut audit: Vec<Audit> = Vec::new();
        for index in audited {
            let (group, name) =
                (index / group_size.max(1), EpisodeId { lease: id.clone(), index }.to_string());
            match audit.last_mut().filter(|last| last.group == group) {
                Some(known) => {
                    known.entries.push(index);
                    known.episodes.push(name);
                }
                None => audit.push(Audit { group, entries: vec![index], episodes: vec![name] }),
            }
        }
        Self {
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
}

/// Claim how all episodes of a lease of columns went. The answer comes after the columns are on disk, and says which groups are
/// audited: their logs are due, as results, within the lease's time. When all have replayed to what was claimed the claim is
/// accepted; one that does not refuses it whole. The same columns again are answered as before.
#[utoipa::path(
    post, path = "/runs/{run}/leases/{lease}/columns", tag = "results", request_body = ColumnsWish,
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = Claim), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The lease is over, or other columns came before."),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn claim(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, lease)): Path<(String, String)>,
    request: Request,
) -> Result<axum::Json<Claim>, Problem> {
    let place = (run_id(&run)?, id("lease", &lease)?);
    let (body, _room) = app.room.body(request).await?;
    let (policy_version, columns) = aside(move || columns_of(body)).await?;
    Ok(axum::Json(Claim::of(store_claim::claim(&app.desk, place.0, place.1, policy_version, columns).await?)))
}

/// The columns of a body, and the policy version it names.
fn columns_of(Bytes(form, body): Bytes) -> Result<(Option<u32>, Columns), Problem> {
    let ColumnsWish { policy_version, score, failed, steps } = read(form, &body)?;
    if let Some(at) = failed.0.iter().position(|failed| *failed > 1) {
        return Err(Problem::invalid(format!("failed.{at}"), "it is neither 0 nor 1"));
    }
    let failed = failed.0.into_iter().map(|failed| failed == 1).collect();
    Ok((policy_version, Columns { scores: score.0, failed, steps: steps.0 }))
}

/// What was claimed, as it came.
#[derive(Serialize, ToSchema)]
pub(super) struct Entries {
    /// `claimed`, `accepted`, `refused` or `unproven`.
    state: String,
    /// The score of each episode of the lease.
    score: Vec<f32>,
    /// 1 where it failed; empty where none did.
    failed: Vec<u8>,
    /// Steps flown; empty where nothing was said of them.
    steps: Vec<u32>,
}

/// Read the columns of a lease back, whatever became of them.
#[utoipa::path(
    get, path = "/runs/{run}/leases/{lease}/columns/entries", tag = "results",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = Entries), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 410, body = Problem, description = "The run keeps them no longer.")
    )
)]
pub(super) async fn entries(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<Entries>, Problem> {
    let (run, lease) = (run_id(&run)?, id("lease", &lease)?);
    let mut conn = app.readers.acquire().await?;
    let row = find_lease(&mut conn, &run, &lease).await?;
    is_kept(&row)?;
    let claimed = status::claimed_columns(&mut conn, row.id).await?.ok_or_else(none)?;
    let (state, Columns { scores, failed, steps }) = (claimed.state.to_string(), claimed.columns);
    let failed = failed.into_iter().map(u8::from).collect();
    Ok(axum::Json(Entries { state, score: scores, failed, steps }))
}

/// That what was claimed is kept.
fn is_kept(lease: &LeaseRow) -> Result<(), Problem> {
    if !lease.is_compacted { Ok(()) } else { Err(ServiceError::Expired(lease.name()).into()) }
}

fn none() -> Problem {
    Problem::new(axum::http::StatusCode::NOT_FOUND, "no_columns", "No columns came for this lease.")
}

/// Show what was claimed of a lease, and what became of it.
#[utoipa::path(
    get, path = "/runs/{run}/leases/{lease}/columns", tag = "results",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = Claim), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 410, body = Problem, description = "The run keeps them no longer.")
    )
)]
pub(super) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<Claim>, Problem> {
    let (run, lease) = (run_id(&run)?, id("lease", &lease)?);
    let mut conn = app.readers.acquire().await?;
    let row = find_lease(&mut conn, &run, &lease).await?;
    is_kept(&row)?;
    Ok(axum::Json(Claim::of(status::claim_status(&mut conn, row).await?.ok_or_else(none)?)))
}
