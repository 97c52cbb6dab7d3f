//! The result of a simulation in numbers.

use serde::Serialize;

use super::runner::{SimulatedGroup, SimulationTrace};
use crate::MoveKind;

/// Summary of a simulation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SimulationSummary {
    /// Ability of the learner at the end, in rows, as the mean over the tasks.
    pub ability: f64,
    /// Mean difficulty of the last tenth of the groups, in rows.
    pub difficulty: f64,
    /// Success rate of the second half of the groups, of those that the learner learnt from.
    pub success: f64,
    /// The same for contested scenarios only.
    pub contested_success: f64,
    /// Share of these groups whose episodes all had the same result; `None` if no group has several episodes.
    pub flat: Option<f64>,
    /// Share of the groups that the learner learnt from.
    pub trained: f64,
    /// Smallest share of a task in the proposals.
    pub least_share: f64,
    /// Number of moves up, of all tasks.
    pub ups: usize,
    /// Number of moves down, of all tasks.
    pub downs: usize,
    /// Number of episodes before all tasks were placed; `None` if some never were.
    pub placed_after: Option<u64>,
    /// Level at the end, as the mean over the tasks; `None` under a strategy without levels.
    pub level: Option<f64>,
    /// Mean of the mastery that is shown at the end, as the mean over the tasks and levels with slots.
    pub shown: Option<f64>,
    /// Success rate of the slots of the second half, reported or not.
    pub true_success: Option<f64>,
    /// Share of the outcomes behind the shown mastery that are missing.
    pub missing: Option<f64>,
    /// Warnings of all tasks at the end.
    pub warnings: Vec<String>,
}

impl SimulationSummary {
    /// Summarises a finished simulation.
    #[must_use]
    pub fn new(trace: &SimulationTrace) -> Self {
        let tasks = trace.status.len().max(1);
        let half = &trace.groups[trace.groups.len() / 2..];
        let trained: Vec<&SimulatedGroup> = half.iter().filter(|group| group.train).collect();
        let contested: Vec<&SimulatedGroup> =
            trained.iter().copied().filter(|group| group.contested).collect();
        let several = trained.iter().filter(|group| group.finished > 1);
        let moves = |kind: MoveKind| trace.moves.iter().filter(|made| made.level_move.kind == kind).count();
        let last_tenth = &trace.groups[trace.groups.len() - trace.groups.len().div_ceil(10)..];
        let mut by_task = vec![0usize; tasks];
        trace.groups.iter().for_each(|group| by_task[group.task_index] += 1);
        let mastery: Vec<_> = trace.curriculum.mastery().into_iter().filter(|shown| shown.n > 0).collect();
        let slots: Vec<&SimulatedGroup> = half.iter().filter(|group| group.is_slot).collect();
        let abilities = trace.status.iter().map(|status| trace.learner.ability(&status.task));
        Self {
            ability: abilities.sum::<f64>() / tasks as f64,
            difficulty: mean(last_tenth.iter().map(|group| group.difficulty)).unwrap_or(0.0),
            success: success_rate(&trained),
            contested_success: success_rate(&contested),
            flat: mean(several.map(|group| f64::from(u8::from(group.has_zero_variance())))),
            trained: mean(half.iter().map(|group| f64::from(u8::from(group.train)))).unwrap_or(0.0),
            least_share: by_task.iter().min().copied().unwrap_or(0) as f64 / trace.groups.len().max(1) as f64,
            ups: moves(MoveKind::Up),
            downs: moves(MoveKind::Down),
            placed_after: placed_after(trace),
            level: mean(trace.status.iter().filter_map(|status| status.level).map(f64::from)),
            shown: mean(mastery.iter().map(|shown| shown.mean)),
            true_success: (!slots.is_empty()).then(|| success_rate(&slots)),
            missing: mean(mastery.iter().map(|shown| shown.missing)),
            warnings: trace.status.iter().flat_map(|status| status.warnings.clone()).collect(),
        }
    }
}

fn placed_after(trace: &SimulationTrace) -> Option<u64> {
    if trace.status.iter().any(|status| !status.placement_done) {
        return None;
    }
    let placements = trace.moves.iter().filter(|made| made.level_move.kind == MoveKind::Placement);
    Some(placements.map(|made| made.episodes_before).max().unwrap_or(0))
}

fn success_rate(groups: &[&SimulatedGroup]) -> f64 {
    let successes: u64 = groups.iter().map(|group| u64::from(group.successes)).sum();
    let finished: u64 = groups.iter().map(|group| u64::from(group.finished)).sum();
    if finished == 0 { 0.0 } else { successes as f64 / finished as f64 }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0u32), |(sum, n), value| (sum + value, n + 1));
    (n > 0).then(|| sum / f64::from(n))
}
