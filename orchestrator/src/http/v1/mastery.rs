//! Mastery of a run's tasks, level moves, and the params in force.

use crate::api_enums::ConvertEnum;
use std::collections::BTreeMap;

use ::curriculum::{Mastery, SamplerState, TaskStatus};
use api_types::{
    ClaimedEpisodeCounts, EpisodeCounts, EvidencePoint, GroupCounts, LevelMovePage, MasteryEstimate,
    PageQuery, RecordedMove, RunMastery, RunParams, TaskMastery,
};
use axum::extract::State;
use store::columns::ClaimCounters;
use store::group_counters::GroupCounters;
use store::progress::{self, TaskSpan};
use store::task_counters::TaskCounters;
use store::{curriculum, from_json};

use crate::http::extract::{NoQuery, Path, Query};
use crate::http::paging::{PageCursor, next_cursor, number_after, page_limit};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::queries::run_progress::{RunProgress, RunProgressQuery};
use clock::rfc3339;

/// Largest number of parts of a task's evidence.
const EVIDENCE_POINTS: usize = 100;

/// Get the current mastery of all tasks of a run.
#[utoipa::path(
    get, path = "/runs/{run}/mastery", tag = "mastery", params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunMastery), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn get_mastery(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<RunMastery>, Problem> {
    let RunProgress { status, mastery, explanation, samplers, sums, designed, claimed, groups, .. } =
        app.writer.query(RunProgressQuery { run: parse_run_id(&run)? }).await?;
    let counts = |sums: &BTreeMap<String, TaskCounters>, task: &str| {
        episode_counts(sums.get(task).unwrap_or(&TaskCounters::default()))
    };
    let tasks = status.into_iter().map(|status| {
        let task = status.task.clone();
        let estimates = mastery.iter().filter(|estimate| estimate.task == task);
        let sampler = samplers.iter().find(|sampler| sampler.task == task);
        TaskMastery {
            mean_rung: sampler.and_then(SamplerState::mean_rung),
            results: counts(&sums, &task),
            designed_results: counts(&designed, &task),
            claimed_results: claimed_counts(claimed.get(&task).unwrap_or(&ClaimCounters::default())),
            group_counts: group_counts(groups.iter().filter(|sums| sums.task == task)),
            ..task_mastery(status, estimates.map(mastery_estimate).collect())
        }
    });
    Ok(axum::Json(RunMastery { tasks: tasks.collect(), explanation }))
}

/// Mastery of a task, without its counts of episodes and groups.
fn task_mastery(status: TaskStatus, levels: Vec<MasteryEstimate>) -> TaskMastery {
    let known = levels.iter().find(|estimate| estimate.level == status.level).copied();
    TaskMastery {
        task: status.task.clone(),
        level: status.level.filter(|_| status.placement_done),
        probe_level: status.probe_level,
        placement_done: status.placement_done,
        mean_rung: None,
        params: status.params.iter().cloned().collect(),
        mastery: known.or_else(|| status.level.map(MasteryEstimate::without_evidence)),
        levels,
        results: EpisodeCounts::default(),
        designed_results: EpisodeCounts::default(),
        claimed_results: claimed_counts(&ClaimCounters::default()),
        group_counts: GroupCounts::default(),
        warnings: status.warnings.clone(),
        held_back: status.held_back.clone(),
        status,
    }
}

fn mastery_estimate(m: &Mastery) -> MasteryEstimate {
    let Mastery { level, n, mean, q10, q90, missing, open, seen, .. } = *m;
    MasteryEstimate { level, n, mean, q10, q90, missing, open, seen }
}

fn group_counts<'a>(counters: impl Iterator<Item = &'a GroupCounters>) -> GroupCounts {
    let mut groups = GroupCounts::default();
    for sums in counters {
        groups.complete += sums.complete;
        groups.partial += sums.partial;
        groups.lost += sums.lost;
        groups.zero_variance += sums.zero_variance;
    }
    let counted = groups.complete + groups.partial;
    groups.zero_variance_share = (counted > 0).then(|| groups.zero_variance as f64 / counted as f64);
    groups
}

fn episode_counts(sums: &TaskCounters) -> EpisodeCounts {
    let mean = |sum: f64, n: i64| (n > 0).then(|| sum / n as f64);
    let missing = sums.failed + sums.expired;
    let ended = sums.episodes + missing;
    EpisodeCounts {
        episodes: sums.episodes,
        successes: sums.successes,
        failed: sums.failed,
        expired: sums.expired,
        success: mean(sums.successes as f64, ended),
        success_high: mean((sums.successes + missing) as f64, ended),
        missing: mean(missing as f64, ended),
        score: mean(sums.score_sum, sums.episodes),
        skill: mean(sums.skill_sum, sums.episodes_with_skill),
    }
}

fn claimed_counts(sums: &ClaimCounters) -> ClaimedEpisodeCounts {
    let ClaimCounters { episodes, score_sum: score, failed, refused, unproven, expired, .. } = *sums;
    let score = (episodes > 0).then(|| score / episodes as f64);
    ClaimedEpisodeCounts { episodes, score, failed, refused, unproven, expired }
}

fn evidence_point(TaskSpan { task, span: s }: TaskSpan) -> EvidencePoint {
    let levels = s.lowest_level.zip(s.highest_level).map(|(low, high)| [low, high]);
    let success = s.success_rate_sum / s.groups as f64;
    EvidencePoint { task, at: rfc3339(s.at), levels, n: s.groups, success }
}

/// List the level moves of a run with their evidence, oldest first.
#[utoipa::path(
    get, path = "/runs/{run}/level_moves", tag = "mastery",
    params(("run" = String, Path, description = "The run's id."), PageQuery),
    responses(
        (status = 200, body = LevelMovePage), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn list_level_moves(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<LevelMovePage>, Problem> {
    let (run, limit) = (parse_run_id(&run)?, page_limit(page.limit)?);
    let after = number_after(page.cursor.as_deref())?;
    let mut conn = acquire_run_reader(&app, &run).await?;
    let rows = curriculum::moves(&mut conn, run.as_str(), after, limit).await?;
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| PageCursor::at(row.seq)));
    let moves = rows
        .into_iter()
        .map(|row| {
            Ok(RecordedMove {
                seq: row.seq,
                task: row.task,
                kind: row.kind.convert(),
                from: row.from_level,
                to: row.to_level,
                evidence: from_json("a move's evidence", &row.evidence)?,
                at: rfc3339(row.at),
            })
        })
        .collect::<Result<_, Problem>>()?;
    let points = match page.cursor {
        Some(_) => Vec::new(),
        None => progress::of_run(&mut conn, run.as_str(), EVIDENCE_POINTS).await?,
    };
    Ok(axum::Json(LevelMovePage { moves, points: points.into_iter().map(evidence_point).collect(), next }))
}

/// Get the current params of a run, by task.
#[utoipa::path(
    get, path = "/runs/{run}/params", tag = "mastery", params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunParams), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn get_params(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<RunParams>, Problem> {
    let progress = app.writer.query(RunProgressQuery { run: parse_run_id(&run)? }).await?;
    let tasks = progress.status.into_iter().map(|s| (s.task, s.params.into_iter().collect())).collect();
    Ok(axum::Json(RunParams { tasks }))
}
