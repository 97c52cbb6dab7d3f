//! Checks of stored curricula: their events are complete, and lead to the stored snapshots, level moves and levels.

use anyhow::Context;
use curriculum::{Curriculum, CurriculumEvent, LevelMove, RestoreError, Snapshot};
use serde_json::Value;
use sqlx::SqliteConnection;
use store::curriculum::{self as rows, CurriculumRecord, EventRange, LevelMoveKind, LevelMoveRow};
use store::{from_json, proposals, runs, to_i64, to_json, to_u64};

use super::findings::{FindingKind, Findings};
use orchestrator::engine::run_state::{RunState, move_kind};

/// Events and moves that are read at a time.
const PAGE: i64 = 5000;

/// Checks without a fold that a run has all events that its snapshots and proposals follow. Retention deletes events at the
/// beginning, but only of runs with compacted leases.
pub(super) async fn check_events(
    conn: &mut SqliteConnection,
    run: &str,
    is_compacted: bool,
    findings: &mut Findings,
) -> anyhow::Result<()> {
    let EventRange { first, last, count } = rows::event_range(conn, run).await?;
    let snapshot = rows::newest_snapshot(conn, run).await?.map_or(0, |snapshot| snapshot.seq);
    let proposed = proposals::last_seq(conn, run).await?.map_or(0, |seq| seq + 1);
    let (first, next) = (first.unwrap_or(0), last.map_or(0, |last| last + 1));
    let missing_inside = next - first - count;
    let missing_after = snapshot.max(proposed) - next;
    if missing_inside > 0 {
        findings.add(
            FindingKind::Events,
            format!("run {run} lacks {missing_inside} of its events {first} to {next}"),
        );
    }
    if missing_after > 0 {
        findings.add(
            FindingKind::Events,
            format!("run {run} lacks its last {missing_after} events, from {next} on"),
        );
    }
    if first > 0 && !is_compacted {
        findings.add(FindingKind::Events, format!("run {run} lacks its first {first} events"));
    }
    Ok(())
}

/// Checks without a fold that each level move begins where the one before ended, and that the last one leads to the current level.
/// Settings that changed may have set a level too, so such runs are left out.
pub(super) async fn check_moves(
    conn: &mut SqliteConnection,
    state: &RunState,
    findings: &mut Findings,
) -> anyhow::Result<()> {
    let run = &state.run;
    if runs::settings_history(conn, run, i64::MAX, 2).await?.len() > 1 {
        return Ok(());
    }
    let moves = stored_moves(conn, run, 0).await?;
    for status in state.curriculum.status() {
        let task = &status.task;
        let mut level = None;
        for row in moves.iter().filter(|row| row.task == *task) {
            if level.is_some() && row.from_level != level {
                let found = format!("run {run} lacks a level move of {task} before event {}", row.seq);
                findings.add(FindingKind::Moves, found);
            }
            level = Some(row.to_level);
        }
        let current = status.level.filter(|_| status.placement_done).map(i64::from);
        if level.is_some() && level != current {
            findings.add(FindingKind::Moves, format!("run {run} lacks the last level move of {task}"));
        }
    }
    Ok(())
}

/// Folds all events of a run, and compares the result with the stored snapshots, moves and levels.
pub(super) async fn check_fold(
    conn: &mut SqliteConnection,
    run: &str,
    findings: &mut Findings,
) -> anyhow::Result<()> {
    let mut fold = match Fold::start(conn, run).await {
        Ok(fold) => fold,
        Err(error) => {
            findings.add(FindingKind::Runs, format!("the events of run {run} cannot be folded: {error:#}"));
            return Ok(());
        }
    };
    let begins_at = to_i64(fold.curriculum.next_seq());
    if let Err(error) = fold.replay(conn, findings).await {
        let seq = fold.curriculum.next_seq();
        findings.add(FindingKind::Events, format!("event {seq} of run {run} cannot be replayed: {error:#}"));
        return Ok(()); // what follows from the missing events is no finding of its own
    }
    let stored = stored_moves(conn, run, begins_at).await?;
    compare_moves(run, &fold.moves, &stored, findings)?;
    if let Ok(state) = RunState::load(conn, run).await {
        for (shown, folded) in state.curriculum.status().iter().zip(fold.curriculum.status()) {
            if shown.level != folded.level {
                let levels = [shown.level, folded.level].map(|level| level.map_or(-1, i64::from));
                let found = format!(
                    "run {run} shows level {} of {}, but its events lead to {}",
                    levels[0], shown.task, levels[1]
                );
                findings.add(FindingKind::Levels, found);
            }
        }
    }
    Ok(())
}

/// A fold over the events of a run.
struct Fold {
    run: String,
    curriculum: Curriculum,
    /// Snapshots that the fold has not reached, oldest first.
    snapshots: Vec<CurriculumRecord>,
    /// Moves that the events caused, with the seq of the event.
    moves: Vec<(i64, LevelMove)>,
}

impl Fold {
    /// Starts at event 0, or at the oldest snapshot if retention has deleted earlier events.
    async fn start(conn: &mut SqliteConnection, run: &str) -> anyhow::Result<Self> {
        let row = runs::get(conn, run).await?.context("the run does not exist")?;
        let mut snapshots = rows::snapshots(conn, run).await?;
        let seed = to_u64(row.seed);
        let first = rows::event_range(conn, run).await?.first.unwrap_or(0);
        let curriculum = if first > 0 && !snapshots.is_empty() {
            let oldest = snapshots.remove(0);
            Curriculum::restore(seed, from_json::<Snapshot>("a snapshot", &oldest.body)?)?
        } else {
            let settings = orchestrator::engine::run_state::first_settings(conn, &row).await?;
            Curriculum::new(seed, settings)?
        };
        Ok(Self { run: run.to_owned(), curriculum, snapshots, moves: Vec::new() })
    }

    async fn replay(&mut self, conn: &mut SqliteConnection, findings: &mut Findings) -> anyhow::Result<()> {
        loop {
            self.compare_snapshot(findings)?;
            let page = rows::events(conn, &self.run, to_i64(self.curriculum.next_seq()), PAGE).await?;
            if page.is_empty() {
                return Ok(());
            }
            for CurriculumRecord { seq, body } in page {
                self.compare_snapshot(findings)?;
                let event: CurriculumEvent = from_json("a curriculum event", &body)?;
                let moves = apply(&mut self.curriculum, to_u64(seq), &event)?;
                // Proposals that need the result of a job are then made again, too, and not taken from their events.
                self.curriculum.take_background_jobs().iter().for_each(|job| job.run());
                self.moves.extend(moves.into_iter().map(|level_move| (seq, level_move)));
            }
        }
    }

    /// Compares the fold with the snapshot that was stored at this event, if there is one.
    fn compare_snapshot(&mut self, findings: &mut Findings) -> anyhow::Result<()> {
        let next = to_i64(self.curriculum.next_seq());
        while self.snapshots.first().is_some_and(|snapshot| snapshot.seq <= next) {
            let CurriculumRecord { seq, body } = self.snapshots.remove(0);
            let mut stored: Value = from_json("a snapshot", &body)?;
            let mut folded = serde_json::to_value(self.curriculum.snapshot())?;
            // Snapshots of earlier versions have no draws by rung, and these decide nothing.
            for snapshot in [&mut stored, &mut folded] {
                if let Some(fields) = snapshot.as_object_mut() {
                    fields.remove("rungs");
                }
            }
            if seq == next && stored != folded {
                let found =
                    format!("the snapshot of run {} before event {seq} differs from its events", self.run);
                findings.add(FindingKind::Snapshots, found);
            }
        }
        Ok(())
    }
}

/// Applies a stored event, and returns the level moves that it causes.
fn apply(
    curriculum: &mut Curriculum,
    seq: u64,
    event: &CurriculumEvent,
) -> Result<Vec<LevelMove>, RestoreError> {
    match event {
        CurriculumEvent::Outcome(outcome) if seq == curriculum.next_seq() => {
            Ok(curriculum.observe(outcome).moves)
        }
        CurriculumEvent::Withdrawn(slots) if seq == curriculum.next_seq() => {
            Ok(curriculum.withdraw_slots(slots).moves)
        }
        event => curriculum.replay_event(seq, event).map(|()| Vec::new()),
    }
}

/// Compares the moves of a fold with the stored ones. Both are in the order of their events.
fn compare_moves(
    run: &str,
    folded: &[(i64, LevelMove)],
    stored: &[LevelMoveRow],
    findings: &mut Findings,
) -> anyhow::Result<()> {
    for (seq, level_move) in folded {
        let LevelMove { task, kind, from, to, evidence } = level_move;
        let found = stored.iter().find(|row| row.seq == *seq && row.task == *task);
        let Some(row) = found else {
            findings
                .add(FindingKind::Moves, format!("run {run} lacks the level move of {task} by event {seq}"));
            continue;
        };
        let kind: LevelMoveKind = move_kind(*kind);
        let is_same = row.kind == kind
            && row.from_level == from.map(i64::from)
            && row.to_level == i64::from(*to)
            && from_json::<Value>("a move's evidence", &row.evidence)?
                == from_json::<Value>("a move's evidence", &to_json(evidence)?)?;
        if !is_same {
            findings.add(
                FindingKind::Moves,
                format!("the level move of {task} by event {seq} of run {run} differs"),
            );
        }
    }
    for row in stored {
        if !folded.iter().any(|(seq, level_move)| row.seq == *seq && row.task == level_move.task) {
            let found =
                format!("no event of run {run} causes its level move of {} by event {}", row.task, row.seq);
            findings.add(FindingKind::Moves, found);
        }
    }
    Ok(())
}

/// Reads all level moves of a run by events from `first` on.
async fn stored_moves(
    conn: &mut SqliteConnection,
    run: &str,
    first: i64,
) -> anyhow::Result<Vec<LevelMoveRow>> {
    let (mut moves, mut after) = (Vec::new(), first - 1);
    loop {
        let page = rows::moves(conn, run, after, PAGE).await?;
        let Some(last) = page.last() else { return Ok(moves) };
        after = last.seq;
        moves.extend(page);
    }
}
