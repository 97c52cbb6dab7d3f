//! Curricula: duration of a proposal, and of the replay of a million events.

use std::time::Instant;

use curriculum::simulation::runner::group_outcome;
use curriculum::simulation::{Learner, LearnerKind, SyntheticScenario};
use curriculum::{
    Curriculum, CurriculumEvent, ObservedOutcome, SequencedProposal, Settings, StrategyKind, TaskPlan,
    difficulty,
};
use env_core::KeyedRng;
use env_core::keyed_rng::RngPurpose;

use crate::Row;

/// Proposals of each strategy; with their outcomes, a million events.
const PROPOSALS: usize = 500_000;
/// Goal of the 99th percentile of a proposal, in seconds.
const PROPOSE_S: f64 = 50e-6;
/// Goal of the replay of a million events, in seconds.
const RESTORE_S: f64 = 5.0;
/// Largest number of events after the newest snapshot, which a restart replays.
const SINCE_SNAPSHOT: usize = 1000;

/// Measures each strategy on three tasks with a simulated learner.
pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for strategy in StrategyKind::ALL {
        rows.extend(measure_strategy(strategy)?);
    }
    Ok(rows)
}

fn measure_strategy(strategy: StrategyKind) -> anyhow::Result<Vec<Row>> {
    let tasks: Vec<String> = env_core::default_tasks().iter().map(|task| task.id().to_owned()).collect();
    let plans = tasks.iter().map(|task| TaskPlan::standard(task)).collect::<Result<Vec<_>, _>>()?;
    let settings = Settings::ladder(plans).with_strategy(strategy);
    let mut curriculum = Curriculum::new(1, settings.clone())?;
    let mut learner = Learner::new(LearnerKind::Slow, &tasks);
    let mut draws = KeyedRng::new(RngPurpose::Simulation, 1, 0);
    let (mut durations, mut events) = (Vec::with_capacity(PROPOSALS), Vec::with_capacity(2 * PROPOSALS));
    let mut snapshot = None;
    for number in 0..PROPOSALS {
        let start = Instant::now();
        let SequencedProposal { seq, proposal } = curriculum.propose();
        durations.push(start.elapsed().as_secs_f64());
        let plan = settings.task(&proposal.task).ok_or_else(|| anyhow::anyhow!("a task of its own"))?;
        let scenario = SyntheticScenario::draw(1, seq, &proposal, difficulty(plan, &proposal.params));
        let results = learner.run_group(&proposal.task, &scenario, 8, proposal.train, &mut draws);
        let outcome = group_outcome(seq, &proposal, &scenario, results);
        events.push((seq, CurriculumEvent::Proposed(proposal)));
        let ObservedOutcome { seq, .. } = curriculum.observe(&outcome);
        events.push((seq, CurriculumEvent::Outcome(outcome)));
        if 2 * (PROPOSALS - number) == SINCE_SNAPSHOT {
            snapshot = Some((serde_json::to_string(&curriculum.snapshot())?, events.len()));
        }
    }
    durations.sort_by(f64::total_cmp);
    let p99 = durations[durations.len() * 99 / 100];
    let mut rows = vec![Row {
        label: format!("{strategy}: a proposal, p99 of {PROPOSALS}"),
        measured: format!("{:.1} µs", 1e6 * p99),
        goal: format!("< {:.0} µs", 1e6 * PROPOSE_S),
        ratio: Some(PROPOSE_S / p99),
    }];
    let replay_s = replay_events(Curriculum::new(1, settings)?, &events)?;
    rows.push(Row {
        label: format!("{strategy}: replay of {} events", events.len()),
        measured: format!("{replay_s:.2} s"),
        goal: format!("< {RESTORE_S} s"),
        ratio: Some(RESTORE_S / replay_s),
    });
    if let Some((text, at)) = snapshot {
        let start = Instant::now();
        let restored = Curriculum::restore(1, serde_json::from_str(&text)?)?;
        replay_events(restored, &events[at..])?;
        let restore_s = start.elapsed().as_secs_f64();
        rows.push(Row {
            label: format!(
                "{strategy}: restored from its snapshot ({} KiB) and {SINCE_SNAPSHOT} events",
                text.len() / 1024
            ),
            measured: format!("{:.1} ms", 1e3 * restore_s),
            goal: format!("< {RESTORE_S} s"),
            ratio: Some(RESTORE_S / restore_s),
        });
    }
    Ok(rows)
}

/// Replays the events and returns the duration in seconds.
fn replay_events(mut curriculum: Curriculum, events: &[(u64, CurriculumEvent)]) -> anyhow::Result<f64> {
    let start = Instant::now();
    for (seq, event) in events {
        curriculum.replay_event(*seq, event)?;
    }
    Ok(start.elapsed().as_secs_f64())
}
