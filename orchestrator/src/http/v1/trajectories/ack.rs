//! Acknowledging groups.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::super::super::extract::{Json, NoQuery, Path};
use super::super::super::problem::Problem;
use super::super::{reader_of, run_id};
use crate::http::state::AppState;
use crate::rollouts::feed::AcknowledgeGroups;

/// Most ids of a request.
const MOST: usize = 10_000;

/// What a trainer has taken.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::http::v1) struct AckWish {
    /// Ids of groups, at most 10 000.
    ids: Vec<u64>,
}

/// What became of it.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Acked {
    /// Groups that are acknowledged, now or before.
    acked: Vec<i64>,
    /// Ids of no group of this run: never, or no longer kept.
    unknown: Vec<i64>,
}

/// Acknowledge groups: they are not delivered again, and leave room for others. Doing so twice is the same as once.
#[utoipa::path(
    post, path = "/runs/{run}/trajectories/ack", tag = "trajectories", request_body = AckWish,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = Acked), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn ack(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(wish): Json<AckWish>,
) -> Result<axum::Json<Acked>, Problem> {
    let run = run_id(&run)?;
    if wish.ids.len() > MOST {
        let detail = format!("{} ids; at most {MOST} are taken at a time", wish.ids.len());
        return Err(Problem::invalid("ids", detail));
    }
    drop(reader_of(&app, &run).await?);
    let never = |at| Problem::invalid(format!("ids.{at}"), "no group ever has such a number");
    let ids = wish.ids.into_iter().enumerate().map(|(at, id)| i64::try_from(id).map_err(|_| never(at)));
    let ids = ids.collect::<Result<_, _>>()?;
    let (acked, unknown) = app.writer.change(AcknowledgeGroups { run, ids }).await?;
    Ok(axum::Json(Acked { acked, unknown }))
}
