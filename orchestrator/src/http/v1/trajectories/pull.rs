//! Pulling groups: claimed for a time, or read again by a cursor.

use std::time::Duration;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use serde::{Deserialize, Serialize};
use tokio::time::Instant;
use utoipa::{IntoParams, ToSchema};

use super::super::super::answers::{Form, wanted};
use super::super::super::extract::{Path, Query};
use super::super::super::problem::Problem;
use super::super::{reader_of, run_id};
use super::answer::{Stored, answer};
use crate::ids::RunId;
use crate::http::state::AppState;
use crate::store::trajectories::{self, FeedGroup};
use crate::engine::error::ServiceError;
use crate::rollouts::trajectory_group::TrajectoryGroup;
use crate::rollouts::feed::{fitting, DeliverGroups};

/// How groups are pulled.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(in crate::http::v1) struct Pull {
    /// How many groups at most: 1 to 256 (8). An answer is at most 32 MiB of JSON, but for a single group.
    limit: Option<u32>,
    /// How long to wait where there is none, seconds: 0 to 60 (0).
    wait_s: Option<u32>,
    /// For how long they are nobody else's, seconds: 1 to 86 400 (600). What is not acknowledged by then is delivered again.
    ttl_s: Option<u32>,
    /// Reads again what came after this id, without claiming it, whether or not it was acknowledged.
    after: Option<u64>,
}

/// Groups of a feed.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Pulled {
    /// In order of their ids.
    groups: Vec<Delivered>,
    /// The last id: what came later is read by `after`.
    next: Option<i64>,
}

/// A group, and what became of it.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Delivered {
    /// Its id, by which it is acknowledged and told from others: never used twice.
    id: i64,
    /// How often it was delivered, this time included. More than once: it may have been taken before.
    deliveries: i64,
    /// The group.
    #[serde(flatten)]
    group: TrajectoryGroup,
}

/// What is pulled, checked.
struct Wish {
    run: RunId,
    limit: i64,
    wait: Duration,
    how: How,
}

enum How {
    Claim { ttl_ms: i64 },
    After(i64),
}

impl Wish {
    fn read(run: &str, pull: &Pull) -> Result<Self, Problem> {
        let within = |field: &str, value: Option<u32>, usual: u32, min: u32, max: u32| {
            let value = value.unwrap_or(usual);
            if (min..=max).contains(&value) {
                Ok(value)
            } else {
                Err(Problem::invalid(field, format!("it is {value}, outside {min} to {max}")))
            }
        };
        let how = match pull.after {
            None => How::Claim { ttl_ms: i64::from(within("ttl_s", pull.ttl_s, 600, 1, 86_400)?) * 1000 },
            Some(_) if pull.ttl_s.is_some() => {
                return Err(Problem::invalid("ttl_s", "what is read again by `after` is not claimed"));
            }
            Some(after) => How::After(i64::try_from(after).unwrap_or(i64::MAX)),
        };
        Ok(Self {
            run: run_id(run)?,
            limit: i64::from(within("limit", pull.limit, 8, 1, 256)?),
            wait: Duration::from_secs(within("wait_s", pull.wait_s, 0, 0, 60)?.into()),
            how,
        })
    }

    /// What there is for it now.
    async fn look(&self, app: &AppState) -> Result<Vec<FeedGroup>, Problem> {
        let ttl_ms = {
            let mut conn = app.readers.acquire().await?;
            match self.how {
                How::After(after) => {
                    let heads = trajectories::after(&mut conn, self.run.as_str(), after, self.limit).await?;
                    return Ok(fitting(heads));
                }
                How::Claim { ttl_ms } => {
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

    /// When there will be something without a push: a group comes again whose time is over.
    async fn again(&self, app: &AppState) -> Result<Option<Duration>, Problem> {
        if let How::After(_) = self.how {
            return Ok(None);
        }
        let mut conn = app.readers.acquire().await?;
        let at = trajectories::next_deliverable_at(&mut conn, self.run.as_str()).await?;
        // A moment at least: the clock may stand at the very millisecond.
        Ok(at.map(|at| Duration::from_millis(u64::try_from(at - app.clock.now()).unwrap_or(0).max(10))))
    }

    /// Waits until there is something for it, or its time is over.
    async fn wait(&self, app: &AppState) -> Result<Vec<FeedGroup>, Problem> {
        let _place = if self.wait.is_zero() { None } else { Some(app.polls.enter()?) };
        let until = Instant::now() + self.wait;
        let mut watch = app.polls.watch();
        loop {
            watch.seen();
            let heads = self.look(app).await?;
            if !heads.is_empty() || Instant::now() >= until {
                return Ok(heads);
            }
            let again = self.again(app).await?.map_or(until, |again| until.min(Instant::now() + again));
            if !watch.next(again).await {
                return Ok(Vec::new());
            }
        }
    }
}

/// Pull finished groups, in order. They are claimed for `ttl_s`: acknowledged in that time they are done with, else they
/// are delivered again, so that each is delivered at least once; `id` tells repeats. With `after` groups are read again,
/// which claims nothing. With `wait_s` an answer comes as soon as there is a group.
#[utoipa::path(
    get, path = "/runs/{run}/trajectories", tag = "trajectories",
    params(("run" = String, Path, description = "The run's id."), Pull),
    responses(
        (status = 200, description = "Groups; as lines (a group a line) or MessagePack where `Accept` says so.", content(
            (Pulled = "application/json"), (Delivered = "application/x-ndjson"), (Pulled = "application/msgpack")
        )),
        (status = 400, body = Problem), (status = 404, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem, description = "Too many wait already; see Retry-After."),
        (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn pull(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(pull): Query<Pull>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let wish = Wish::read(&run, &pull)?;
    drop(reader_of(&app, &wish.run).await?);
    let heads = wish.wait(&app).await?;
    let mut groups = Vec::with_capacity(heads.len());
    let mut conn = app.readers.acquire().await.map_err(ServiceError::from)?;
    for head in heads {
        // Acknowledged and dropped in between: nobody needs it.
        if let Some(body) = trajectories::body(&mut conn, head.id).await? {
            groups.push(Stored { head, body });
        }
    }
    let next = match (groups.last(), &wish.how) {
        (Some(last), _) => Some(last.head.id),
        (None, How::After(after)) => Some(*after),
        (None, How::Claim { .. }) => None,
    };
    Ok(answer(wanted(&headers, &[Form::Json, Form::Lines, Form::MessagePack]), groups, next))
}
