//! The policy that the server flies for a run.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::super::extract::{Json, NoQuery, Path};
use super::super::problem::Problem;
use super::{reader_of, run_id};
use crate::clock::rfc3339;
use crate::ids::RunId;
use crate::http::state::AppState;
use crate::store::run_policies::{self, RunPolicy, TokenCounts};
use crate::store::trajectories;
use crate::rollouts::feed::MOST_WAITING;
use crate::rollouts::settings::PutPolicy;
use crate::rollouts::{PolicySettings, PolicyRequest};

/// The policy of a run, and how it goes.
#[derive(Serialize, ToSchema)]
pub(super) struct PolicyView {
    /// `off`, `chat`, or a built-in policy by name.
    policy: String,
    /// Its version, which groups begun now carry.
    version: i64,
    /// How it is set.
    #[serde(flatten)]
    settings: PolicySettings,
    /// The model that `chat` asks; where it is, only the server knows.
    model: Option<String>,
    /// When it was set, RFC 3339.
    changed_at: Option<String>,
    /// Groups pushed to the feed so far.
    groups: i64,
    /// Episodes in them.
    episodes: i64,
    /// Episodes that the infrastructure lost: the model's endpoint, as a rule.
    failed: i64,
    /// Tokens that the model read and wrote.
    tokens_in: i64,
    /// Tokens that it wrote.
    tokens_out: i64,
    /// How full the feed is.
    feed: FeedView,
    /// The last thing that went wrong.
    trouble: Option<TroubleView>,
}

/// How full a feed is.
#[derive(Serialize, ToSchema)]
struct FeedView {
    /// Groups that wait to be delivered.
    waiting: i64,
    /// Groups delivered, their time not over.
    delivered: i64,
    /// Groups acknowledged that can still be read again.
    acked: i64,
    /// Bytes of those that are not acknowledged, as stored.
    bytes: i64,
    /// Nothing more is flown until some are acknowledged.
    full: bool,
}

/// Something that went wrong.
#[derive(Serialize, ToSchema)]
struct TroubleView {
    /// What, in a sentence.
    words: String,
    /// When, RFC 3339.
    at: String,
}

/// Show the policy of a run: which, how it is set, and how it goes.
#[utoipa::path(
    get, path = "/runs/{run}/policy", tag = "trajectories", params(("run" = String, Path, description = "The run's id.")),
    responses((status = 200, body = PolicyView), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(super) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<PolicyView>, Problem> {
    Ok(axum::Json(look(&app, &run_id(&run)?).await?))
}

/// Set the policy of a run: which the server's workers fly for it, into its feed. `chat` asks the language model that the
/// server was started with; no request can name another.
#[utoipa::path(
    put, path = "/runs/{run}/policy", tag = "trajectories", request_body = PolicyRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = PolicyView), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem),
        (status = 422, body = Problem, description = "Among others: a version that is lower than the run's."),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn put(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(wish): Json<PolicyRequest>,
) -> Result<axum::Json<PolicyView>, Problem> {
    let run = run_id(&run)?;
    drop(reader_of(&app, &run).await?); // of a run that is not there nothing else is wrong
    app.writer.change(PutPolicy::read(run.clone(), &wish, app.endpoint.as_ref())?).await?;
    tracing::info!(%run, policy = wish.policy, "The policy of a run was set.");
    Ok(axum::Json(look(&app, &run).await?))
}

async fn look(app: &AppState, run: &RunId) -> Result<PolicyView, Problem> {
    let mut conn = reader_of(app, run).await?;
    let row = run_policies::get(&mut conn, run.as_str()).await?;
    let settings = row.as_ref().map(PolicySettings::of).transpose()?.unwrap_or_default();
    let TokenCounts { tokens_in, tokens_out } = run_policies::tokens(&mut conn, run.as_str()).await?;
    let feed = trajectories::counts(&mut conn, run.as_str(), app.clock.now()).await?;
    let unacked = feed.waiting + feed.delivered;
    let policy = row.as_ref().map_or(RunPolicy::Off, |row| row.policy.clone());
    let model = app.endpoint.as_ref().filter(|_| policy == RunPolicy::Chat).map(|e| e.llm.config().model.clone());
    let trouble = row.as_ref().and_then(|row| {
        Some(TroubleView { words: row.trouble.clone()?, at: rfc3339(row.trouble_at.unwrap_or_default()) })
    });
    let (groups, episodes, failed) =
        row.as_ref().map_or((0, 0, 0), |row| (row.groups, row.episodes, row.failed));
    Ok(PolicyView {
        policy: policy.to_string(),
        version: row.as_ref().map_or(0, |row| row.version),
        model,
        changed_at: row.as_ref().map(|row| rfc3339(row.changed_at)),
        groups,
        episodes,
        failed,
        tokens_in,
        tokens_out,
        feed: FeedView {
            waiting: feed.waiting,
            delivered: feed.delivered,
            acked: feed.acked,
            bytes: feed.bytes,
            full: unacked >= i64::from(settings.ahead) || feed.bytes >= MOST_WAITING,
        },
        trouble,
        settings,
    })
}
