//! Health of the server in one place.

use std::time::Duration;

use api_types::{DiskHealth, ServerHealth, VERSION, WriterHealth};
use axum::extract::State;
use store::{alerts, critiques, integrity};

use crate::disk_space::free_bytes;
use crate::engine::commit_log::{CommitSummary, WINDOW};
use crate::engine::writer::{QUEUE_CAPACITY, QueueLengths, Writer};
use crate::http::extract::NoQuery;
use crate::http::problem::Problem;
use crate::http::state::AppState;

/// Get the health of the server: its writer, its disk, and what waits.
#[utoipa::path(
    get, path = "/health", tag = "health",
    responses((status = 200, body = ServerHealth), (status = 400, body = Problem))
)]
pub(super) async fn get_server_health(
    _: NoQuery,
    State(app): State<AppState>,
) -> Result<axum::Json<ServerHealth>, Problem> {
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let pages = integrity::page_bytes(&mut conn).await?;
    let waiting = critiques::waiting_by_run(&mut conn).await?;
    let alerts = alerts::count_lasting(&mut conn).await?;
    drop(conn);
    Ok(axum::Json(ServerHealth {
        version: VERSION.to_owned(),
        shard: app.shards.own().map(ToString::to_string),
        uptime_s: app.started.elapsed().as_secs_f64(),
        outage: app.writer.health().reason(),
        writer: writer_health(&app.writer, app.started.elapsed()),
        disk: DiskHealth {
            database_bytes: pages.all,
            reusable_bytes: pages.free,
            free_bytes: free_bytes(&app.folder),
        },
        critiques_waiting: waiting.values().sum(),
        sessions: app.sessions.active(),
        sessions_limit: app.sessions.limits().max_sessions,
        alerts,
    }))
}

fn writer_health(writer: &Writer, uptime: Duration) -> WriterHealth {
    let QueueLengths { urgent, bulk } = writer.queue_lengths();
    let CommitSummary { commits, changes, failed, median, p99 } = writer.commits().summarize();
    let seconds = uptime.min(WINDOW).as_secs_f64().max(1.0);
    let ms = |duration: Duration| 1e3 * duration.as_secs_f64();
    WriterHealth {
        urgent_waiting: urgent,
        bulk_waiting: bulk,
        queue_capacity: QUEUE_CAPACITY,
        commits_per_s: commits as f64 / seconds,
        changes_per_s: changes as f64 / seconds,
        failed_commits: failed,
        commit_p50_ms: median.map(ms),
        commit_p99_ms: p99.map(ms),
    }
}
