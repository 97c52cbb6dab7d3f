//! Curricula: how long a proposal takes, and how long a million events take to be folded again.

use std::time::Instant;

use curriculum::simulation::drive::outcome;
use curriculum::simulation::synthetic::Synthetic;
use curriculum::simulation::{Learner, LearnerKind};
use curriculum::{Curriculum, CurriculumEvent, Settings, StrategyKind, TaskPlan, difficulty};
use env_core::Draws;
use env_core::draws::Purpose;

use crate::Row;

/// Proposals of each strategy; with the outcome of each a million events.
const PROPOSALS: usize = 500_000;
/// A proposal takes less in 99 of 100 cases, seconds.
const PROPOSE_S: f64 = 50e-6;
/// A million events are folded in less, seconds.
const RESTORE_S: f64 = 5.0;
/// Events after the newest snapshot at most: what a restart folds.
const SINCE_SNAPSHOT: usize = 1000;

/// Each strategy over three tasks, with a learner that learns.
pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for strategy in StrategyKind::ALL {
        rows.extend(of(strategy)?);
    }
    Ok(rows)
}

fn of(strategy: StrategyKind) -> anyhow::Result<Vec<Row>> {
    let tasks: Vec<String> = env_core::usual_tasks().iter().map(|task| task.id().to_owned()).collect();
    let plans = tasks.iter().map(|task| TaskPlan::standard(task)).collect::<Result<Vec<_>, _>>()?;
    let settings = Settings::ladder(plans).by(strategy);
    let mut curriculum = Curriculum::new(1, settings.clone())?;
    let mut learner = Learner::new(LearnerKind::Slow, &tasks);
    let mut draws = Draws::new(Purpose::Synthetic, 1, 0);
    let (mut took, mut events) = (Vec::with_capacity(PROPOSALS), Vec::with_capacity(2 * PROPOSALS));
    let mut snapshot = None;
    for number in 0..PROPOSALS {
        let begun = Instant::now();
        let (seq, proposal) = curriculum.propose();
        took.push(begun.elapsed().as_secs_f64());
        let plan = settings.task(&proposal.task).ok_or_else(|| anyhow::anyhow!("a task of its own"))?;
        let scenario = Synthetic::drawn(1, seq, &proposal, difficulty(plan, &proposal.params));
        let flown = learner.fly(&proposal.task, &scenario, (8, proposal.train), &mut draws);
        let outcome = outcome(seq, &proposal, &scenario, flown);
        events.push((seq, CurriculumEvent::Proposed(proposal)));
        let (seq, _) = curriculum.observe(&outcome);
        events.push((seq, CurriculumEvent::Outcome(outcome)));
        if 2 * (PROPOSALS - number) == SINCE_SNAPSHOT {
            snapshot = Some((serde_json::to_string(&curriculum.snapshot())?, events.len()));
        }
    }
    took.sort_by(f64::total_cmp);
    let p99 = took[took.len() * 99 / 100];
    let mut rows = vec![Row {
        what: format!("{strategy}: a proposal, p99 of {PROPOSALS}"),
        measured: format!("{:.1} µs", 1e6 * p99),
        goal: format!("< {:.0} µs", 1e6 * PROPOSE_S),
        ratio: Some(PROPOSE_S / p99),
    }];
    let folded = fold(Curriculum::new(1, settings)?, &events)?;
    rows.push(Row {
        what: format!("{strategy}: {} events folded from the first", events.len()),
        measured: format!("{folded:.2} s"),
        goal: format!("< {RESTORE_S} s"),
        ratio: Some(RESTORE_S / folded),
    });
    if let Some((text, at)) = snapshot {
        let begun = Instant::now();
        let restored = Curriculum::restore(1, serde_json::from_str(&text)?)?;
        fold(restored, &events[at..])?;
        let took = begun.elapsed().as_secs_f64();
        rows.push(Row {
            what: format!(
                "{strategy}: restored from its snapshot ({} KiB) and {SINCE_SNAPSHOT} events",
                text.len() / 1024
            ),
            measured: format!("{:.1} ms", 1e3 * took),
            goal: format!("< {RESTORE_S} s"),
            ratio: Some(RESTORE_S / took),
        });
    }
    Ok(rows)
}

/// Seconds.
fn fold(mut curriculum: Curriculum, events: &[(u64, CurriculumEvent)]) -> anyhow::Result<f64> {
    let begun = Instant::now();
    for (seq, event) in events {
        curriculum.replay(*seq, event)?;
    }
    Ok(begun.elapsed().as_secs_f64())
}
