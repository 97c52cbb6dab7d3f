//! Critiques of finished episodes on one thread: built-in policies on every task of a world at easy, medium and hard levels.

use std::sync::Arc;
use std::time::Instant;

use env_core::rollout::roll_out;
use env_core::{Recipe, Scenario, Seed};

use crate::Row;

const LEVELS: [usize; 4] = [0, 3, 6, 9];
const POLICIES: [&str; 3] = ["heuristic", "frozen", "random"];
/// Number of repetitions; the shortest time counts, so that other load has little influence.
const REPEATS: u32 = 3;

/// A world whose critiques are measured.
struct MeasuredWorld {
    name: &'static str,
    /// Scenarios of each level.
    scenarios: u64,
    /// Goal of the mean, ms.
    goal_ms: f64,
}

const WORLDS: [MeasuredWorld; 2] = [
    MeasuredWorld { name: "kessler", scenarios: 60, goal_ms: 1.0 },
    MeasuredWorld { name: "tasking", scenarios: 3, goal_ms: 300.0 },
];

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for MeasuredWorld { name, scenarios, goal_ms } in WORLDS {
        let mut all = Vec::new();
        for policy in POLICIES {
            let times = times_ms(name, policy, scenarios)?;
            all.extend_from_slice(&times);
            rows.push(row(&format!("critique of a {name} episode, run by {policy}"), times, None));
        }
        rows.push(row(&format!("critique of a {name} episode, all policies"), all, Some(goal_ms)));
    }
    Ok(rows)
}

/// Times of the critiques of a policy's episodes, ms.
fn times_ms(world: &str, policy: &str, scenarios: u64) -> anyhow::Result<Vec<f64>> {
    let mut times = Vec::new();
    for task in env_core::tasks().filter(|task| task.world().starts_with(world)) {
        for level in LEVELS {
            let recipe = Arc::new(Recipe::at_level(task, level)?);
            for seed in 0..scenarios {
                let scenario = Scenario::new(Arc::clone(&recipe), Seed::user(seed)?);
                let mut agent = task.policy(policy, &scenario, seed)?;
                let log = roll_out(&scenario, &mut *agent)?.log;
                let mut shortest = f64::MAX;
                for _ in 0..REPEATS {
                    let start = Instant::now();
                    std::hint::black_box(task.critique(&scenario, &log)?);
                    shortest = shortest.min(start.elapsed().as_secs_f64() * 1e3);
                }
                times.push(shortest);
            }
        }
    }
    Ok(times)
}

fn row(label: &str, mut times: Vec<f64>, goal: Option<f64>) -> Row {
    times.sort_by(f64::total_cmp);
    let mean = times.iter().sum::<f64>() / times.len() as f64;
    let p99 = times[times.len() * 99 / 100];
    Row {
        label: label.to_owned(),
        measured: format!("{mean:.3} ms mean, {p99:.2} p99"),
        goal: goal.map_or_else(String::new, |goal| format!("≤ {goal} ms mean")),
        ratio: goal.map(|goal| goal / mean),
    }
}
