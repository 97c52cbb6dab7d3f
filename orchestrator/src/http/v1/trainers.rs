//! Activity of the trainers of a run.

use api_types::{ActiveTrainer, TrainerList};
use axum::extract::State;
use store::runs;

use crate::engine::error::ServiceError;
use crate::http::extract::{NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::trainer_activity::{TrainerSummary, WINDOW};

/// List the trainers that sent requests to a run within an hour.
///
/// Sessions are not trainers here: their episodes run on the server. The numbers begin anew when the server starts.
#[utoipa::path(
    get, path = "/runs/{run}/trainers", tag = "runs", params(("run" = String, Path, description = "The run's id.")),
    responses((status = 200, body = TrainerList), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(super) async fn list_trainers(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<TrainerList>, Problem> {
    let run = parse_run_id(&run)?;
    let row = runs::get(&mut *app.readers.acquire().await?, run.as_str()).await?;
    let newest = row.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?.policy_version;
    let trainers = app.trainers.of_run(run.as_str()).into_iter().map(|summary| trainer(summary, newest));
    Ok(axum::Json(TrainerList { window_s: WINDOW.as_secs_f64(), trainers: trainers.collect() }))
}

fn trainer(summary: TrainerSummary, newest: i64) -> ActiveTrainer {
    // A trainer that came this second has no rate yet.
    let covered = summary.covered.as_secs_f64().max(1.0);
    let wait = summary.lease_wait.as_secs_f64();
    ActiveTrainer {
        name: summary.key.name,
        client: summary.key.client.map(|client| client.to_string()),
        idle_s: summary.idle.as_secs_f64(),
        requests_per_s: summary.requests as f64 / covered,
        errors: summary.errors,
        leases: summary.leases,
        episodes_per_s: summary.episodes as f64 / covered,
        lease_wait_s: (summary.leases > 0).then(|| wait / summary.leases as f64),
        waiting_share: (wait / covered).min(1.0),
        policy_version: summary.policy_version,
        staleness: summary.policy_version.map(|version| (newest - version).max(0)),
    }
}
