//! Mastery: where each task stands, how it came there, and the params in force.

use std::collections::BTreeMap;

use axum::extract::State;
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::super::extract::{NoQuery, Path, Query};
use super::super::problem::Problem;
use super::{Page, next, reader_of, run_id};
use crate::clock::rfc3339;
use crate::http::state::AppState;
use crate::store::group_counters::GroupCounters;
use crate::store::columns::ClaimCounters;
use crate::store::progress::{self, TaskSpan};
use crate::store::task_counters::TaskCounters;
use crate::store::{curriculum, from_json};
use crate::queries::run_progress::{RunProgress, RunProgressQuery};
use ::curriculum::{Explanation, Mastery, TaskStatus};

/// Points of a curve over time.
const POINTS: usize = 100;

/// What an agent has mastered.
#[derive(Serialize, ToSchema)]
pub(super) struct Masteries {
    /// One per task of the run.
    tasks: Vec<TaskMastery>,
    /// The strategy's rules, and what moved on what evidence, in words.
    #[schema(value_type = Object)]
    explanation: Explanation,
}

/// One task.
#[derive(Serialize, ToSchema)]
struct TaskMastery {
    /// The task.
    task: String,
    /// The current level; none during placement, and where the strategy has no levels.
    level: Option<u32>,
    /// The level that placement probes now.
    probing: Option<u32>,
    /// Whether the level was found.
    placed: bool,
    /// The params in force: of the current level, or of the one that is probed.
    params: BTreeMap<String, f64>,
    /// The posterior over success on contested scenarios at the current level; none where there are no levels.
    mastery: Option<Posterior>,
    /// The same at every level with evidence.
    levels: Vec<Posterior>,
    /// Success over all episodes, contested or not, but those of designed layouts.
    plain: Plain,
    /// The same of designed layouts, which are made to be failed.
    designed: Plain,
    /// What was claimed in columns: statistics, but for the groups that were audited, which count above.
    claimed: ClaimedView,
    /// How groups of several episodes ended; all zeros where groups have one.
    groups: Groups,
    /// How full the current block is, what it takes to move.
    #[schema(value_type = Object)]
    status: TaskStatus,
    /// What somebody should know.
    warnings: Vec<String>,
}

/// Beta(1, 1) and the last 64 contested scenarios.
#[derive(Serialize, ToSchema)]
struct Posterior {
    /// The level.
    level: Option<u32>,
    /// Scenarios it rests on.
    n: u32,
    /// Mean.
    mean: f64,
    /// 10 % quantile.
    q10: f64,
    /// 90 % quantile.
    q90: f64,
    /// Scenarios seen since the run began.
    seen: u64,
}

impl Posterior {
    fn of(m: &Mastery) -> Self {
        Self { level: m.level, n: m.n, mean: m.mean, q10: m.q10, q90: m.q90, seen: m.seen }
    }
}

impl Posterior {
    /// Before any evidence: Beta(1, 1), uniform.
    const fn unseen(level: u32) -> Self {
        Self { level: Some(level), n: 0, mean: 0.5, q10: 0.1, q90: 0.9, seen: 0 }
    }
}

/// How groups of several episodes ended, at all levels together.
#[derive(Default, Serialize, ToSchema)]
struct Groups {
    /// All of their episodes finished.
    complete: i64,
    /// `min_group` or more of them finished.
    partial: i64,
    /// Fewer finished.
    lost: i64,
    /// Of the complete and partial ones, those whose episodes all have the same score: there is nothing to learn from their
    /// differences.
    zero_variance: i64,
    /// zero_variance / (complete + partial).
    zero_variance_share: Option<f64>,
}

impl Groups {
    fn of<'a>(sums: impl Iterator<Item = &'a GroupCounters>) -> Self {
        let mut groups = sums.fold(Self::default(), |all, sums| Self {
            complete: all.complete + sums.complete,
            partial: all.partial + sums.partial,
            lost: all.lost + sums.lost,
            zero_variance: all.zero_variance + sums.flat,
            zero_variance_share: None,
        });
        let counted = groups.complete + groups.partial;
        groups.zero_variance_share = (counted > 0).then(|| groups.zero_variance as f64 / counted as f64);
        groups
    }
}

/// Plain counts over all episodes.
#[derive(Serialize, ToSchema)]
struct Plain {
    /// Episodes that finished.
    episodes: i64,
    /// Of these, successes.
    successes: i64,
    /// Episodes that failed.
    failed: i64,
    /// Episodes that expired.
    expired: i64,
    /// successes / episodes.
    success: Option<f64>,
    /// Mean score.
    score: Option<f64>,
    /// Mean skill, where scenarios define one.
    skill: Option<f64>,
}

impl Plain {
    fn of(sums: &TaskCounters) -> Self {
        let over = |sum: f64, n: i64| (n > 0).then(|| sum / n as f64);
        Self {
            episodes: sums.episodes,
            successes: sums.successes,
            failed: sums.failed,
            expired: sums.expired,
            success: over(sums.successes as f64, sums.episodes),
            score: over(sums.score, sums.episodes),
            skill: over(sums.skill, sums.skilled),
        }
    }
}

/// What was claimed in columns.
#[derive(Serialize, ToSchema)]
struct ClaimedView {
    /// Episodes of accepted claims that finished.
    episodes: i64,
    /// Their mean score, as claimed.
    score: Option<f64>,
    /// Episodes of accepted claims that failed.
    failed: i64,
    /// Episodes of claims that were refused.
    refused: i64,
    /// Episodes of claims whose audited logs never came.
    unproven: i64,
    /// Episodes that were leased and never claimed.
    expired: i64,
}

impl ClaimedView {
    fn of(sums: &ClaimCounters) -> Self {
        let ClaimCounters { episodes, score, failed, refused, unproven, expired, .. } = *sums;
        let score = (episodes > 0).then(|| score / episodes as f64);
        Self { episodes, score, failed, refused, unproven, expired }
    }
}

/// Show what the agent has mastered now.
#[utoipa::path(
    get, path = "/runs/{run}/mastery", tag = "mastery", params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = Masteries), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<Masteries>, Problem> {
    let standing = app.writer.query(RunProgressQuery { run: run_id(&run)? }).await?;
    let RunProgress { status, mastery, explanation, sums, designed, claimed, groups, .. } = standing;
    let tasks = status
        .into_iter()
        .map(|status| {
            let of_task = || mastery.iter().filter(|m| m.task == status.task);
            let plain = |of: &BTreeMap<String, TaskCounters>| {
                Plain::of(of.get(&status.task).unwrap_or(&TaskCounters::default()))
            };
            TaskMastery {
                level: status.level.filter(|_| status.placed),
                probing: status.probing,
                placed: status.placed,
                params: status.params.iter().cloned().collect(),
                mastery: of_task()
                    .find(|m| m.level == status.level)
                    .map(Posterior::of)
                    .or_else(|| status.level.map(Posterior::unseen)),
                levels: of_task().map(Posterior::of).collect(),
                plain: plain(&sums),
                designed: plain(&designed),
                claimed: ClaimedView::of(claimed.get(&status.task).unwrap_or(&ClaimCounters::default())),
                groups: Groups::of(groups.iter().filter(|sums| sums.task == status.task)),
                warnings: status.warnings.clone(),
                task: status.task.clone(),
                status,
            }
        })
        .collect();
    Ok(axum::Json(Masteries { tasks, explanation }))
}

/// How levels moved.
#[derive(Serialize, ToSchema)]
pub(super) struct History {
    /// In order.
    moves: Vec<MoveView>,
    /// Success on contested scenarios over time: each task's evidence in at most 100 parts of equal size. Only on the
    /// first page.
    points: Vec<Point>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// A stretch of a task's evidence.
#[derive(Serialize, ToSchema)]
struct Point {
    /// The task.
    task: String,
    /// When it ended, RFC 3339.
    at: String,
    /// The levels in it, lowest and highest.
    levels: Option<[i64; 2]>,
    /// Contested scenarios in it.
    n: i64,
    /// Mean of their success shares.
    success: f64,
}

impl From<TaskSpan> for Point {
    fn from(TaskSpan { task, span: s }: TaskSpan) -> Self {
        let levels = s.low.zip(s.high).map(|(low, high)| [low, high]);
        Self { task, at: rfc3339(s.at), levels, n: s.n, success: s.sum / s.n as f64 }
    }
}

/// One move.
#[derive(Serialize, ToSchema)]
struct MoveView {
    /// The seq of the event that caused it.
    seq: i64,
    /// The task.
    task: String,
    /// `placement`, `up` or `down`.
    kind: String,
    /// The level before.
    from: Option<i64>,
    /// The level after.
    to: i64,
    /// The blocks or probes it rests on.
    #[schema(value_type = Object)]
    evidence: Value,
    /// When, RFC 3339.
    at: String,
}

/// Show every level move with its evidence, oldest first.
#[utoipa::path(
    get, path = "/runs/{run}/mastery/history", tag = "mastery",
    params(("run" = String, Path, description = "The run's id."), Page),
    responses(
        (status = 200, body = History), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn history(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(page): Query<Page>,
) -> Result<axum::Json<History>, Problem> {
    let (run, limit) = (run_id(&run)?, page.limit()?);
    let after = if page.cursor.is_some() { page.cursor()?.0 } else { -1 };
    let mut conn = reader_of(&app, &run).await?;
    let rows = curriculum::moves(&mut conn, run.as_str(), after, limit).await?;
    let next = next(rows.len(), limit, rows.last().map(|row| (row.seq, "")));
    let moves = rows
        .into_iter()
        .map(|row| {
            Ok(MoveView {
                seq: row.seq,
                task: row.task,
                kind: row.kind.to_string(),
                from: row.from_level,
                to: row.to_level,
                evidence: from_json("a move's evidence", &row.evidence)?,
                at: rfc3339(row.at),
            })
        })
        .collect::<Result<_, Problem>>()?;
    let points = match page.cursor {
        Some(_) => Vec::new(),
        None => progress::of_run(&mut conn, run.as_str(), POINTS).await?,
    };
    Ok(axum::Json(History { moves, points: points.into_iter().map(Point::from).collect(), next }))
}

/// The params in force, by task.
#[derive(Serialize, ToSchema)]
pub(super) struct Params {
    /// By task's id.
    tasks: BTreeMap<String, BTreeMap<String, f64>>,
}

/// Show the params in force per task.
#[utoipa::path(
    get, path = "/runs/{run}/params", tag = "mastery", params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = Params), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn params(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<Params>, Problem> {
    let standing = app.writer.query(RunProgressQuery { run: run_id(&run)? }).await?;
    let tasks = standing.status.into_iter().map(|s| (s.task, s.params.into_iter().collect())).collect();
    Ok(axum::Json(Params { tasks }))
}
