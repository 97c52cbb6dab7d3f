//! Workers on other machines.

use api_types::{JobCounters, RemoteWorker, RemoteWorkerList, RemoteWorkerState};
use axum::extract::State;
use job_queue::status::{QueueCounters, QueueStatus, WorkerState, WorkerStatus};

use crate::http::extract::NoQuery;
use crate::http::problem::Problem;
use crate::http::state::AppState;

/// List the workers on other machines.
///
/// A server without `--nats` has none. A worker joins within a second, and leaves the list two minutes after its last heartbeat.
#[utoipa::path(
    get, path = "/workers", tag = "health",
    responses((status = 200, body = RemoteWorkerList), (status = 400, body = Problem))
)]
pub(super) async fn list_workers(
    State(app): State<AppState>,
    _: NoQuery,
) -> Result<axum::Json<RemoteWorkerList>, Problem> {
    let QueueStatus { is_distributed, degraded, waiting, workers, counters } =
        app.lease_service.audits.queue.status();
    Ok(axum::Json(RemoteWorkerList {
        distributed: is_distributed,
        degraded,
        waiting,
        workers: workers.into_iter().map(worker).collect(),
        counters: job_counters(counters),
    }))
}

fn worker(status: WorkerStatus) -> RemoteWorker {
    let WorkerStatus {
        id,
        host,
        version,
        world,
        kinds,
        concurrency,
        active,
        state,
        reason,
        jobs,
        errors,
        ..
    } = status;
    RemoteWorker {
        id,
        host,
        version,
        world,
        state: match state {
            WorkerState::Active => RemoteWorkerState::Active,
            WorkerState::Stalled => RemoteWorkerState::Stalled,
            WorkerState::Refused => RemoteWorkerState::Refused,
            WorkerState::Expelled => RemoteWorkerState::Expelled,
        },
        reason,
        kinds: kinds.iter().map(ToString::to_string).collect(),
        concurrency,
        active_jobs: active,
        jobs,
        jobs_per_s: status.jobs_per_s,
        errors,
        verified: status.verified,
        last_seen_s: status.last_seen.as_secs_f64(),
    }
}

const fn job_counters(counters: QueueCounters) -> JobCounters {
    JobCounters {
        sent: counters.sent,
        done_remotely: counters.done_remotely,
        done_locally: counters.done_locally,
        taken_back: counters.taken_back,
        ignored_results: counters.ignored_results,
        verified: counters.verified_items,
        bytes_sent: counters.bytes_sent,
        bytes_received: counters.bytes_received,
    }
}
