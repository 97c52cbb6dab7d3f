//! What came of a simulation, in numbers.

use serde::Serialize;

use super::drive::{Sample, Track};
use crate::MoveKind;

/// What came of a simulation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// How good the learner is at the end, in rows, on the mean of the tasks.
    pub skill: f64,
    /// How hard what was proposed at the end is, in rows: the mean over the last tenth.
    pub faced: f64,
    /// The share of episodes of the second half that succeeded, of those that were learnt from.
    pub success: f64,
    /// The same of contested scenarios alone.
    pub contested_success: f64,
    /// The share of groups of the second half that were learnt from and came to the same; none of groups of one.
    pub flat: Option<f64>,
    /// The share of groups that were learnt from.
    pub trained: f64,
    /// The least share of proposals that a task had.
    pub least_share: f64,
    /// Levels up, by all tasks.
    pub ups: usize,
    /// Levels down.
    pub downs: usize,
    /// Episodes after which all tasks were placed; none where some never were.
    pub placed_after: Option<u64>,
    /// What somebody should know at the end.
    pub warnings: Vec<String>,
}

impl Summary {
    /// Of all that happened.
    #[must_use]
    pub fn of(track: &Track) -> Self {
        let tasks = track.status.len().max(1);
        let half = &track.samples[track.samples.len() / 2..];
        let trained: Vec<&Sample> = half.iter().filter(|sample| sample.train).collect();
        let contested: Vec<&Sample> = trained.iter().copied().filter(|sample| sample.contested).collect();
        let several: Vec<&Sample> = trained.iter().copied().filter(|sample| sample.finished > 1).collect();
        let count = |kind: MoveKind| track.moves.iter().filter(|(_, made)| made.kind == kind).count();
        let last = &track.samples[track.samples.len() - track.samples.len().div_ceil(10)..];
        let mut shares = vec![0usize; tasks];
        track.samples.iter().for_each(|sample| shares[sample.task] += 1);
        let skills = track.status.iter().map(|status| track.learner.skill(&status.task));
        Self {
            skill: skills.sum::<f64>() / tasks as f64,
            faced: mean(last.iter().map(|sample| sample.params)).unwrap_or(0.0),
            success: success(&trained),
            contested_success: success(&contested),
            flat: mean(several.iter().map(|sample| f64::from(u8::from(sample.flat())))),
            trained: mean(half.iter().map(|sample| f64::from(u8::from(sample.train)))).unwrap_or(0.0),
            least_share: shares.iter().min().copied().unwrap_or(0) as f64 / track.samples.len().max(1) as f64,
            ups: count(MoveKind::Up),
            downs: count(MoveKind::Down),
            placed_after: placed_after(track),
            warnings: track.status.iter().flat_map(|status| status.warnings.clone()).collect(),
        }
    }
}

fn placed_after(track: &Track) -> Option<u64> {
    if track.status.iter().any(|status| !status.placed) {
        return None;
    }
    let placements = track.moves.iter().filter(|(_, made)| made.kind == MoveKind::Placement);
    Some(placements.map(|(at, _)| *at).max().unwrap_or(0))
}

fn success(samples: &[&Sample]) -> f64 {
    let (successes, finished) = samples.iter().fold((0u64, 0u64), |(s, f), sample| {
        (s + u64::from(sample.successes), f + u64::from(sample.finished))
    });
    if finished == 0 { 0.0 } else { successes as f64 / finished as f64 }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0u32), |(sum, n), value| (sum + value, n + 1));
    (n > 0).then(|| sum / f64::from(n))
}
