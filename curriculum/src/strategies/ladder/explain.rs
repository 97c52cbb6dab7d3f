//! Status and explanation of the ladder.

use super::level_stage::LevelStage;
use super::placement::{PASS_MEAN, PROBE_SIZE, Placement};
use super::{Ladder, REHEARSED_LEVELS, TaskProgress, TaskStage};
use crate::core::evidence::block::{
    BLOCK_SIZE, EvidenceBlock, HALF_DOWN_MEAN, HALF_UP_MEAN, MASTERED_Q10, OUT_OF_REACH_Q90, promotion_hold,
};
use crate::core::evidence::slot_queue::SlotQueue;
use crate::core::explanation::{BlockProgress, Explanation, MoveThresholds, TaskExplanation, TaskStatus};
use crate::core::settings::{Settings, Target, TaskPlan};
use crate::core::shares;
use crate::core::strategy::StrategyState;

/// Status of a task.
pub(super) fn task_status(progress: &TaskProgress, plan: &TaskPlan, target: Target) -> TaskStatus {
    let common = TaskStatus { epoch: progress.epoch, ..TaskStatus::without_levels(&plan.task, Vec::new()) };
    match &progress.stage {
        TaskStage::Placement(placement) => TaskStatus {
            level: Some(0),
            placement_done: false,
            probe_level: Some(placement.level()),
            params: plan.params(Some(placement.level())),
            block: Some(block_progress(&placement.filling, &placement.queue, PROBE_SIZE)),
            blocks: u32::try_from(placement.probes.len()).unwrap_or(u32::MAX),
            held_back: placement.queue.waiting_hold(PROBE_SIZE),
            move_conditions: Some(probe_thresholds(placement)),
            earliest_proposal: placement.earliest_proposal(),
            ..common
        },
        TaskStage::Level(stage) => {
            let blocks = stage.last.iter().chain([&stage.filling]).filter_map(|block| block.first);
            let is_hardest = stage.level == plan.hardest_level();
            let missing_hold = || stage.last.as_ref().and_then(|last| promotion_hold(target, last));
            let held_back = stage.queue.waiting_hold(BLOCK_SIZE).or_else(missing_hold);
            TaskStatus {
                level: Some(stage.level),
                params: plan.params(Some(stage.level)),
                block: Some(block_progress(&stage.filling, &stage.queue, BLOCK_SIZE)),
                blocks: stage.blocks,
                held_back: held_back.filter(|_| !is_hardest),
                move_conditions: Some(level_thresholds(stage, plan.hardest_level(), target)),
                earliest_proposal: blocks.chain(stage.queue.earliest_proposal()).min(),
                ..common
            }
        }
    }
}

/// Explains the rules and the state of each task.
pub(super) fn explain(ladder: &Ladder, settings: &Settings) -> Explanation {
    let summary = match settings.target {
        Target::Mastery => {
            "Each task moves up its table when a level is mastered, and down when it is out of reach."
        }
        Target::Half => {
            "Each task stays where about half of the contested scenarios succeed; no mastery is claimed."
        }
    };
    let tasks = settings.tasks.iter().zip(shares::task_shares(settings)).filter_map(|(plan, share)| {
        let progress = ladder.tasks.get(&plan.task)?;
        Some(TaskExplanation {
            task: plan.task.clone(),
            share,
            current_state: describe_progress(progress),
            last_move: progress.last_move.as_ref().map(|made| made.evidence.sentence.clone()),
        })
    });
    Explanation {
        strategy: settings.strategy.to_string(),
        version: Ladder::VERSION,
        summary: summary.to_owned(),
        rules: rules(settings),
        tasks: tasks.collect(),
    }
}

fn block_progress(filling: &EvidenceBlock, queue: &SlotQueue, size: u32) -> BlockProgress {
    let is_empty = filling.n == 0;
    BlockProgress {
        n: filling.n,
        size,
        low: filling.low,
        high: filling.high,
        mean: (!is_empty).then(|| filling.mean_low()),
        missing: (!is_empty).then(|| filling.missing_share()),
        open: queue.open_count(),
        waiting: queue.waiting_count(),
    }
}

fn probe_thresholds(placement: &Placement) -> MoveThresholds {
    let level = placement.level();
    MoveThresholds {
        up: Some(format!(
            "level {level} passes with a mean of at least {PASS_MEAN} over {PROBE_SIZE} contested scenarios"
        )),
        down: Some(format!("below that it fails, and placement continues below level {level}")),
    }
}

fn level_thresholds(stage: &LevelStage, hardest_level: u32, target: Target) -> MoveThresholds {
    let last = stage.last.map_or_else(String::new, |last| match target {
        Target::Mastery => format!(" (the last block has {:.2} and {:.2})", last.q10(), last.q90()),
        Target::Half => String::new(),
    });
    let (up, down) = match target {
        Target::Mastery => (
            format!(
                "two consecutive blocks of {BLOCK_SIZE} with a 10 % quantile of at least \
                 {MASTERED_Q10:.2}: 26 of {BLOCK_SIZE} each{last}"
            ),
            format!(
                "two consecutive blocks of {BLOCK_SIZE} with a 90 % quantile of at most \
                 {OUT_OF_REACH_Q90:.2}: 6 of {BLOCK_SIZE} each{last}"
            ),
        ),
        Target::Half => (
            format!("one block of {BLOCK_SIZE} with a mean above {HALF_UP_MEAN}"),
            format!("one block of {BLOCK_SIZE} with a mean below {HALF_DOWN_MEAN}"),
        ),
    };
    MoveThresholds {
        up: (stage.level < hardest_level).then_some(up),
        down: (stage.level > 0).then_some(down),
    }
}

fn rules(settings: &Settings) -> Vec<String> {
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let mut rules = vec![
        "Tasks share the proposals by weight, each at least 5 %.".to_owned(),
        "One contested scenario is one observation: the share of its episodes that succeeded. A missing \
         episode counts as a failure for moves up, and as a success for moves down."
            .to_owned(),
    ];
    if settings.placement {
        rules.push(format!(
            "A new task is placed by bisection, {PROBE_SIZE} contested scenarios a level; a level passes \
             at a mean of {PASS_MEAN}."
        ));
    }
    rules.push(format!(
        "{} of the proposals are at the current level, the others among the {REHEARSED_LEVELS} below it; \
         {} must be contested, the others need not be.",
        percent(settings.frontier_share),
        percent(settings.contested_share),
    ));
    rules.push(match settings.target {
        Target::Mastery => format!(
            "Up when two consecutive blocks of {BLOCK_SIZE} have their 10 % quantile at {MASTERED_Q10:.2} \
             or more, down when two have their 90 % quantile at {OUT_OF_REACH_Q90:.2} or less."
        ),
        Target::Half => format!(
            "Up after a full block of {BLOCK_SIZE} with a mean above {HALF_UP_MEAN}, down after one with \
             a mean below {HALF_DOWN_MEAN}."
        ),
    });
    rules.push(
        "Scenarios count in the order in which they were leased, and only by the first attempt.".to_owned(),
    );
    rules
}

fn describe_progress(progress: &TaskProgress) -> String {
    match &progress.stage {
        TaskStage::Placement(placement) => format!(
            "in placement: probing level {}, {} of {PROBE_SIZE} scenarios reported, {} levels probed before",
            placement.level(),
            placement.filling.n,
            placement.probes.len()
        ),
        TaskStage::Level(stage) => format!(
            "at level {}, {} full {} since the last move, {} of {BLOCK_SIZE} scenarios in the next",
            stage.level,
            stage.blocks,
            if stage.blocks == 1 { "block" } else { "blocks" },
            stage.filling.n
        ),
    }
}
