//! The stage after placement: blocks of slots at the current level, and the moves that they cause.

use serde::{Deserialize, Serialize};

use crate::core::evidence::block::{
    BLOCK_SIZE, BlockVerdict, EvidenceBlock, HALF_DOWN_MEAN, HALF_UP_MEAN, MASTERED_Q10, OUT_OF_REACH_Q90,
    judge_blocks,
};
use crate::core::evidence::level_move::{MoveEvidence, MoveKind};
use crate::core::evidence::slot_queue::SlotQueue;
use crate::core::settings::Target;

/// Current level of a task and its blocks since the last move.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct LevelStage {
    pub(super) level: u32,
    /// Slots of the current level that are not settled.
    pub(super) queue: SlotQueue,
    pub(super) filling: EvidenceBlock,
    /// The latest full block.
    pub(super) last: Option<EvidenceBlock>,
    /// Number of full blocks.
    pub(super) blocks: u32,
}

/// Step to a neighbouring level, with its evidence.
pub(super) struct LevelStep {
    pub(super) kind: MoveKind,
    pub(super) evidence: MoveEvidence,
}

impl LevelStage {
    /// Moves settled slots into blocks, up to the step that they cause. At the ends of the table the blocks simply
    /// continue.
    pub(super) fn settle(&mut self, target: Target, hardest_level: u32) -> Option<LevelStep> {
        while let Some(settled) = self.queue.next_settled() {
            if let Some(full) = self.filling.record_until_full(settled, BLOCK_SIZE)
                && let Some(step) = self.judge(full, target, hardest_level)
            {
                return Some(step);
            }
        }
        None
    }

    /// Judges a full block and returns the step it causes.
    fn judge(&mut self, full: EvidenceBlock, target: Target, hardest_level: u32) -> Option<LevelStep> {
        self.blocks = self.blocks.saturating_add(1);
        let previous = self.last.replace(full);
        let kind = match judge_blocks(target, previous.as_ref(), &full) {
            BlockVerdict::Up if self.level < hardest_level => MoveKind::Up,
            BlockVerdict::Down if self.level > 0 => MoveKind::Down,
            _ => return None,
        };
        let blocks = match target {
            Target::Mastery => previous.into_iter().chain([full]).collect(),
            Target::Half => vec![full],
        };
        Some(LevelStep { kind, evidence: move_evidence(kind, target, &blocks) })
    }

    /// Reason of a proposal at the current level.
    pub(super) fn describe_frontier(&self, contested: bool) -> String {
        let how = if contested { "contested" } else { "as it comes" };
        format!(
            "the current level {}, {how}: {} of {BLOCK_SIZE} scenarios of block {} are in",
            self.level,
            self.filling.n,
            self.blocks.saturating_add(1)
        )
    }
}

/// Evidence of a step that rests on these blocks, with its reason in one sentence.
fn move_evidence(kind: MoveKind, target: Target, blocks: &[EvidenceBlock]) -> MoveEvidence {
    let list = |value: fn(&EvidenceBlock) -> f64| {
        blocks.iter().map(|block| format!("{:.2}", value(block))).collect::<Vec<_>>().join(" and ")
    };
    let lows = list(|block| block.low);
    let highs = list(|block| block.high);
    let sentence = match (target, kind) {
        (Target::Mastery, MoveKind::Down) => format!(
            "{highs} of {BLOCK_SIZE} contested scenarios in two consecutive blocks: 90 % quantiles {} are at \
             most {OUT_OF_REACH_Q90:.2}",
            list(EvidenceBlock::q90)
        ),
        (Target::Mastery, _) => format!(
            "{lows} of {BLOCK_SIZE} contested scenarios in two consecutive blocks: 10 % quantiles {} are at \
             least {MASTERED_Q10:.2}",
            list(EvidenceBlock::q10)
        ),
        (Target::Half, MoveKind::Down) => format!(
            "{highs} of {BLOCK_SIZE} contested scenarios: the mean is below {HALF_DOWN_MEAN}; no claim of \
             mastery"
        ),
        (Target::Half, _) => format!(
            "{lows} of {BLOCK_SIZE} contested scenarios: the mean is above {HALF_UP_MEAN}; no claim of mastery"
        ),
    };
    MoveEvidence { sentence, blocks: blocks.iter().map(EvidenceBlock::summary).collect(), probes: Vec::new() }
}
