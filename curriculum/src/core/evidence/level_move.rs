//! Level moves, each with the evidence that caused it.

use serde::{Deserialize, Serialize};

/// Direction of a level move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MoveKind {
    /// Placement ended and set the first level.
    Placement,
    /// The level rose by one.
    Up,
    /// The level fell by one.
    Down,
}

/// Change of a task's level, with its evidence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LevelMove {
    /// Id of the task.
    pub task: String,
    /// Direction of the move.
    pub kind: MoveKind,
    /// Level before the move; `None` if placement had not ended.
    pub from: Option<u32>,
    /// Level after the move.
    pub to: u32,
    /// Evidence that caused the move.
    pub evidence: MoveEvidence,
}

/// Blocks or probes that a move rests on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MoveEvidence {
    /// Reason of the move in one sentence.
    pub sentence: String,
    /// Full blocks, oldest first; empty for a placement.
    pub blocks: Vec<BlockSummary>,
    /// Probes of a placement, in order; empty for other moves.
    pub probes: Vec<ProbeSummary>,
}

impl MoveEvidence {
    /// Seq of the earliest proposal behind the evidence. `None` if there is no evidence.
    #[must_use]
    pub fn earliest_proposal(&self) -> Option<u64> {
        let blocks = self.blocks.iter().map(|block| block.first);
        let probes = self.probes.iter().map(|probe| probe.first);
        blocks.chain(probes).collect::<Option<Vec<_>>>()?.into_iter().min()
    }
}

/// Summary of a full block of slots.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BlockSummary {
    /// Number of slots in it.
    pub n: u32,
    /// Sum of their success rates, missing episodes counted as failures.
    pub low: f64,
    /// Sum of their success rates, missing episodes counted as successes.
    pub high: f64,
    /// Mean success rate, low / n.
    pub mean: f64,
    /// 10 % quantile of Beta(1 + low, 1 + n − low).
    pub q10: f64,
    /// 90 % quantile of Beta(1 + high, 1 + n − high).
    pub q90: f64,
    /// Share of the outcomes that are missing, (high − low) / n.
    pub missing: f64,
    /// Seq of the block's earliest proposal; `None` if the block is empty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first: Option<u64>,
}

/// Summary of one probed level of a placement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ProbeSummary {
    /// Level that was probed.
    pub level: u32,
    /// Number of slots in it.
    pub n: u32,
    /// Sum of their success rates, missing episodes counted as failures.
    pub low: f64,
    /// Sum of their success rates, missing episodes counted as successes.
    pub high: f64,
    /// Mean success rate, low / n.
    pub mean: f64,
    /// True if the level passed.
    pub passed: bool,
    /// Seq of the probe's earliest proposal; `None` if the probe is empty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first: Option<u64>,
}
