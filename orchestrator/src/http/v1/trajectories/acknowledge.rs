//! Acknowledgement of delivered groups.

use api_types::{AcknowledgeRequest, AcknowledgeResponse};
use axum::extract::State;

use crate::http::extract::{Json, NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::rollouts::feed::{AcknowledgeGroups, AcknowledgedGroups};

/// Largest number of ids in a request.
const MAX_IDS: usize = 10_000;

/// Acknowledge delivered groups.
///
/// The server does not deliver them again, and runs new groups in their place. A repeated request has no further effect.
#[utoipa::path(
    post, path = "/runs/{run}/trajectories/ack", tag = "trajectories", request_body = AcknowledgeRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = AcknowledgeResponse), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn acknowledge_trajectories(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(request): Json<AcknowledgeRequest>,
) -> Result<axum::Json<AcknowledgeResponse>, Problem> {
    let run = parse_run_id(&run)?;
    if request.ids.len() > MAX_IDS {
        let detail = format!("must have at most {MAX_IDS} entries, got {}", request.ids.len());
        return Err(Problem::invalid("ids", detail));
    }
    drop(acquire_run_reader(&app, &run).await?);
    let too_large = |at| Problem::invalid(format!("ids.{at}"), "is larger than any id of a group");
    let ids =
        request.ids.into_iter().enumerate().map(|(at, id)| i64::try_from(id).map_err(|_| too_large(at)));
    let ids = ids.collect::<Result<_, _>>()?;
    let AcknowledgedGroups { acknowledged, unknown } =
        app.writer.change(AcknowledgeGroups { run, ids }).await?;
    Ok(axum::Json(AcknowledgeResponse { acknowledged, unknown }))
}
