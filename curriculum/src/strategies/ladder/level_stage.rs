//! The stage after placement: blocks of outcomes at the current level, and the moves that they cause.

use serde::{Deserialize, Serialize};

use crate::core::evidence::block::{
    BLOCK_SIZE, BlockVerdict, DiscardedBlocks, EvidenceBlock, HALF_DOWN_MEAN, HALF_UP_MEAN, MASTERED_Q10,
    OUT_OF_REACH_Q90, judge_blocks,
};
use crate::core::evidence::level_move::{MoveEvidence, MoveKind};
use crate::core::outcome::GroupOutcome;
use crate::core::settings::Target;

/// Current level of a task and its blocks since the last move.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct LevelStage {
    pub(super) level: u32,
    pub(super) filling: EvidenceBlock,
    /// Latest full block that counted.
    pub(super) last: Option<EvidenceBlock>,
    /// Number of full blocks that counted.
    pub(super) blocks: u32,
    pub(super) discarded: DiscardedBlocks,
}

/// Step to a neighbouring level, with its evidence.
pub(super) struct LevelStep {
    pub(super) kind: MoveKind,
    pub(super) evidence: MoveEvidence,
}

impl LevelStage {
    /// Records a contested outcome of the current level and returns the step it causes. At the ends of the table the
    /// blocks simply continue.
    pub(super) fn observe(
        &mut self,
        outcome: &GroupOutcome,
        target: Target,
        hardest_level: u32,
    ) -> Option<LevelStep> {
        let full = self.filling.record_until_full(outcome, BLOCK_SIZE, &mut self.discarded)?;
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
            self.blocks + 1
        )
    }
}

/// Evidence of a step that rests on these blocks, with its reason in one sentence.
fn move_evidence(kind: MoveKind, target: Target, blocks: &[EvidenceBlock]) -> MoveEvidence {
    let list = |value: fn(&EvidenceBlock) -> f64| {
        blocks.iter().map(|block| format!("{:.2}", value(block))).collect::<Vec<_>>().join(" and ")
    };
    let sums = list(|block| block.sum);
    let sentence = match (target, kind) {
        (Target::Mastery, MoveKind::Down) => format!(
            "{sums} of {BLOCK_SIZE} contested scenarios in two consecutive blocks: 90 % quantiles {} are at \
             most {OUT_OF_REACH_Q90:.2}",
            list(EvidenceBlock::q90)
        ),
        (Target::Mastery, _) => format!(
            "{sums} of {BLOCK_SIZE} contested scenarios in two consecutive blocks: 10 % quantiles {} are at \
             least {MASTERED_Q10:.2}",
            list(EvidenceBlock::q10)
        ),
        (Target::Half, MoveKind::Down) => format!(
            "{sums} of {BLOCK_SIZE} contested scenarios: the mean is below {HALF_DOWN_MEAN}; no claim of \
             mastery"
        ),
        (Target::Half, _) => format!(
            "{sums} of {BLOCK_SIZE} contested scenarios: the mean is above {HALF_UP_MEAN}; no claim of mastery"
        ),
    };
    MoveEvidence { sentence, blocks: blocks.iter().map(EvidenceBlock::summary).collect(), probes: Vec::new() }
}
