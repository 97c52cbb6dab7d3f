//! Delivery of groups: claimed for a time, or read again from an id.

use std::time::Duration;

use api_types::{DeliveredGroup, TrajectoryPage, TrajectoryQuery};
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use store::ids::RunId;
use store::trajectories::{self, FeedGroup};
use tokio::time::Instant;

use super::response::{PackedFeedGroup, feed_response};
use crate::engine::error::ServiceError;
use crate::http::content_negotiation::{ResponseFormat, negotiate};
use crate::http::extract::{Path, Query};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::rollouts::feed::{DeliverGroups, limit_bytes};

/// Longest time that the server waits for a group. Proxies end requests without a response after 60 s by default.
const MAX_WAIT: Duration = Duration::from_secs(55);

/// Validated request for groups of a feed.
struct PullRequest {
    run: RunId,
    limit: i64,
    wait: Duration,
    mode: PullMode,
}

/// Mode of a request.
enum PullMode {
    /// Claims groups for a time, milliseconds.
    Claim { ttl_ms: i64 },
    /// Reads groups after an id, without a claim.
    After(i64),
}

impl PullRequest {
    fn from_query(run: &str, query: &TrajectoryQuery) -> Result<Self, Problem> {
        let within = |field: &str, value: Option<u32>, default: u32, min: u32, max: u32| {
            let value = value.unwrap_or(default);
            if (min..=max).contains(&value) {
                Ok(value)
            } else {
                Err(Problem::invalid(field, format!("must be from {min} to {max}, got {value}")))
            }
        };
        let mode = match query.after {
            None => {
                PullMode::Claim { ttl_ms: i64::from(within("ttl_s", query.ttl_s, 600, 1, 86_400)?) * 1000 }
            }
            Some(_) if query.ttl_s.is_some() => {
                return Err(Problem::invalid(
                    "ttl_s",
                    "must be left out with `after`, which does not claim groups",
                ));
            }
            Some(after) => PullMode::After(i64::try_from(after).unwrap_or(i64::MAX)),
        };
        Ok(Self {
            run: parse_run_id(run)?,
            limit: i64::from(within("limit", query.limit, 8, 1, 256)?),
            wait: MAX_WAIT.min(Duration::from_secs(within("wait_s", query.wait_s, 0, 0, 60)?.into())),
            mode,
        })
    }

    /// Groups that are available now.
    async fn available(&self, app: &AppState) -> Result<Vec<FeedGroup>, Problem> {
        let ttl_ms = {
            let mut conn = acquire_run_reader(app, &self.run).await?;
            match self.mode {
                PullMode::After(after) => {
                    let heads = trajectories::after(&mut conn, self.run.as_str(), after, self.limit).await?;
                    return Ok(limit_bytes(heads));
                }
                PullMode::Claim { ttl_ms } => {
                    let now = app.clock.now();
                    if trajectories::deliverable(&mut conn, self.run.as_str(), now, 1).await?.is_empty() {
                        return Ok(Vec::new());
                    }
                    ttl_ms
                }
            }
        };
        let deliver = DeliverGroups { run: self.run.clone(), limit: self.limit, ttl_ms };
        Ok(app.writer.change(deliver).await?)
    }

    /// Time until a group can be delivered again because its claim expires.
    async fn until_redelivery(&self, app: &AppState) -> Result<Option<Duration>, Problem> {
        if let PullMode::After(_) = self.mode {
            return Ok(None);
        }
        let mut conn = app.readers.acquire().await?;
        let at = trajectories::next_deliverable_at(&mut conn, self.run.as_str()).await?;
        // At least 10 ms, since the claim may expire in this very millisecond.
        Ok(at.map(|at| Duration::from_millis(u64::try_from(at - app.clock.now()).unwrap_or(0).max(10))))
    }

    /// Waits until a group is available or the time is over.
    async fn wait(&self, app: &AppState) -> Result<Vec<FeedGroup>, Problem> {
        let _permit = if self.wait.is_zero() { None } else { Some(app.long_polls.acquire()?) };
        let until = Instant::now() + self.wait;
        let mut watch = app.long_polls.watch();
        loop {
            watch.mark_seen();
            let heads = self.available(app).await?;
            if !heads.is_empty() || Instant::now() >= until {
                return Ok(heads);
            }
            let again =
                self.until_redelivery(app).await?.map_or(until, |again| until.min(Instant::now() + again));
            if !watch.wait(again).await {
                return Ok(Vec::new());
            }
        }
    }
}

/// Pull finished groups of the trajectory feed, in order.
///
/// The server claims the groups for `ttl_s` seconds, and delivers a group again if it is not acknowledged in that time. So each group
/// is delivered at least once; `id` identifies repeats. With `after` the server returns groups again without a claim. With `wait_s`
/// it responds as soon as there is a group.
#[utoipa::path(
    get, path = "/runs/{run}/trajectories", tag = "trajectories",
    params(("run" = String, Path, description = "The run's id."), TrajectoryQuery),
    responses(
        (status = 200, description = "Groups, as JSON, as JSON lines (one group a line) or as MessagePack, by `Accept`.", content(
            (TrajectoryPage = "application/json"), (DeliveredGroup = "application/x-ndjson"), (TrajectoryPage = "application/msgpack")
        )),
        (status = 400, body = Problem), (status = 404, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem, description = "Too many long polls are open; retry after `Retry-After`."),
        (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn pull_trajectories(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(query): Query<TrajectoryQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let request = PullRequest::from_query(&run, &query)?;
    drop(acquire_run_reader(&app, &request.run).await?);
    let heads = request.wait(&app).await?;
    let mut groups = Vec::with_capacity(heads.len());
    let mut conn = app.readers.acquire().await.map_err(ServiceError::from)?;
    for head in heads {
        // A group without a body was acknowledged and deleted meanwhile.
        if let Some(body) = trajectories::body(&mut conn, head.id).await? {
            groups.push(PackedFeedGroup { head, body });
        }
    }
    let next = match (groups.last(), &request.mode) {
        (Some(last), _) => Some(last.head.id),
        (None, PullMode::After(after)) => Some(*after),
        (None, PullMode::Claim { .. }) => None,
    };
    Ok(feed_response(
        negotiate(&headers, &[ResponseFormat::Json, ResponseFormat::Lines, ResponseFormat::MessagePack]),
        groups,
        next,
    ))
}
