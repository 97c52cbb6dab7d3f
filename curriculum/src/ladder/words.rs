//! The ladder for people.

use super::super::block::{BLOCK, HALF_DOWN, HALF_UP, MASTERED, OUT_OF_REACH, Tally, loss_warnings};
use super::super::event::{Evidence, MoveKind};
use super::super::explain::{BlockFill, Explanation, TaskExplanation, TaskStatus, Thresholds};
use super::super::placement::{PASS, PROBE, Placement};
use super::super::settings::{Settings, Target, TaskPlan};
use super::super::shares;
use super::{Climb, Ladder, REHEARSED, Rung, Stage, VERSION};

/// Why a move was made.
pub(super) fn evidence(kind: MoveKind, target: Target, blocks: &[Tally]) -> Evidence {
    let list = |of: fn(&Tally) -> f64| {
        blocks.iter().map(|block| format!("{:.2}", of(block))).collect::<Vec<_>>().join(" and ")
    };
    let sums = list(|block| block.sum);
    let sentence = match (target, kind) {
        (Target::Mastery, MoveKind::Down) => format!(
            "{sums} of {BLOCK} contested scenarios in two blocks running: 90 % quantiles {} are at most {OUT_OF_REACH:.2}",
            list(Tally::q90)
        ),
        (Target::Mastery, _) => format!(
            "{sums} of {BLOCK} contested scenarios in two blocks running: 10 % quantiles {} are at least {MASTERED:.2}",
            list(Tally::q10)
        ),
        (Target::Half, MoveKind::Down) => {
            format!(
                "{sums} of {BLOCK} contested scenarios: the mean is below {HALF_DOWN}; no claim of mastery"
            )
        }
        (Target::Half, _) => {
            format!("{sums} of {BLOCK} contested scenarios: the mean is above {HALF_UP}; no claim of mastery")
        }
    };
    Evidence { sentence, blocks: blocks.iter().map(Tally::evidence).collect(), probes: Vec::new() }
}

impl Climb {
    /// Where the task stands.
    pub(super) fn status(&self, plan: &TaskPlan, target: Target) -> TaskStatus {
        let shared = TaskStatus { epoch: self.epoch, ..TaskStatus::unmoved(&plan.task, Vec::new()) };
        match &self.stage {
            Stage::Placing(placement) => TaskStatus {
                level: Some(0),
                placed: false,
                probing: Some(placement.level()),
                params: plan.params(Some(placement.level())),
                block: Some(fill(&placement.filling, PROBE)),
                blocks: u32::try_from(placement.probes.len()).unwrap_or(u32::MAX),
                discarded: placement.discarded.count,
                warnings: loss_warnings("probe", " at this level", &placement.discarded, &placement.filling),
                next: Some(probe_thresholds(placement)),
                rests_on: placement.rests_on(),
                ..shared
            },
            Stage::Climbing(rung) => TaskStatus {
                level: Some(rung.level),
                params: plan.params(Some(rung.level)),
                block: Some(fill(&rung.filling, BLOCK)),
                blocks: rung.blocks,
                discarded: rung.discarded.count,
                warnings: loss_warnings("block", " at this level", &rung.discarded, &rung.filling),
                next: Some(thresholds(rung, plan.top(), target)),
                rests_on: rung.last.iter().chain([&rung.filling]).filter_map(Tally::rests_on).min(),
                ..shared
            },
        }
    }
}

fn fill(filling: &Tally, of: u32) -> BlockFill {
    let mean = (filling.n > 0).then(|| filling.mean());
    BlockFill { n: filling.n, of, sum: filling.sum, mean, lost: filling.lost }
}

fn probe_thresholds(placement: &Placement) -> Thresholds {
    let level = placement.level();
    Thresholds {
        up: Some(format!(
            "level {level} passes with a mean of at least {PASS} over {PROBE} contested scenarios"
        )),
        down: Some(format!("below that it fails, and placement goes on below level {level}")),
    }
}

fn thresholds(rung: &Rung, top: u32, target: Target) -> Thresholds {
    let last = rung.last.map_or_else(String::new, |last| match target {
        Target::Mastery => format!(" (the last block has {:.2} and {:.2})", last.q10(), last.q90()),
        Target::Half => String::new(),
    });
    let (up, down) = match target {
        Target::Mastery => (
            format!(
                "two blocks of {BLOCK} running with a 10 % quantile of at least {MASTERED:.2}: 26 of {BLOCK} each{last}"
            ),
            format!(
                "two blocks of {BLOCK} running with a 90 % quantile of at most {OUT_OF_REACH:.2}: 6 of {BLOCK} each{last}"
            ),
        ),
        Target::Half => (
            format!("one block of {BLOCK} with a mean above {HALF_UP}"),
            format!("one block of {BLOCK} with a mean below {HALF_DOWN}"),
        ),
    };
    Thresholds { up: (rung.level < top).then_some(up), down: (rung.level > 0).then_some(down) }
}

/// Rules, and where each task stands.
pub(super) fn explain(ladder: &Ladder, settings: &Settings) -> Explanation {
    let summary = match settings.target {
        Target::Mastery => {
            "Each task climbs its table when a level is mastered, and goes down when it is out of reach."
        }
        Target::Half => {
            "Each task stays where about half of the contested scenarios succeed; no mastery is claimed."
        }
    };
    Explanation {
        strategy: settings.strategy.to_string(),
        version: VERSION,
        summary: summary.to_owned(),
        rules: rules(settings),
        tasks: (settings.tasks.iter().zip(shares::shares(settings)))
            .filter_map(|(plan, share)| {
                let climb = ladder.tasks.get(&plan.task)?;
                Some(TaskExplanation {
                    task: plan.task.clone(),
                    share,
                    now: now(climb),
                    last_move: climb.last_move.as_ref().map(|made| made.evidence.sentence.clone()),
                })
            })
            .collect(),
    }
}

fn rules(settings: &Settings) -> Vec<String> {
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let mut rules = vec![
        "Tasks by their weight, each at least 5 %.".to_owned(),
        "One contested scenario is one observation: the share of its episodes that succeeded.".to_owned(),
    ];
    if settings.placement {
        rules.push(format!(
            "A new task is placed by bisection, {PROBE} contested scenarios a level; a level passes at a mean of {PASS}."
        ));
    }
    rules.push(format!(
        "{} of the proposals are at the current level, the others among the {REHEARSED} below it; {} are contested by \
         choice, the others as they come.",
        percent(settings.frontier_share),
        percent(settings.contested_share),
    ));
    rules.push(match settings.target {
        Target::Mastery => format!(
            "Up when two full blocks of {BLOCK} running have their 10 % quantile at {MASTERED:.2} or more, down when two \
             have their 90 % quantile at {OUT_OF_REACH:.2} or less."
        ),
        Target::Half => format!(
            "Up after a full block of {BLOCK} with a mean above {HALF_UP}, down after one with a mean below {HALF_DOWN}."
        ),
    });
    rules.push(
        "Failed and expired episodes are never a low score; a block that loses more than 10 % of its episodes does not \
         count."
            .to_owned(),
    );
    rules
}

fn now(climb: &Climb) -> String {
    match &climb.stage {
        Stage::Placing(placement) => format!(
            "being placed: probing level {}, {} of {PROBE} scenarios in, {} levels probed before",
            placement.level(),
            placement.filling.n,
            placement.probes.len()
        ),
        Stage::Climbing(rung) => format!(
            "at level {}, {} full {} since the last move, {} of {BLOCK} scenarios in the next",
            rung.level,
            rung.blocks,
            if rung.blocks == 1 { "block" } else { "blocks" },
            rung.filling.n
        ),
    }
}
