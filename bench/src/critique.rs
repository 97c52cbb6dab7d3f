//! Critiques of finished episodes on one thread: built-in policies on every kessler task at easy, medium and hard levels.

use std::sync::Arc;
use std::time::Instant;

use env_core::rollout::roll_out;
use env_core::{Recipe, Scenario, Seed};

use crate::Row;

const LEVELS: [usize; 4] = [0, 3, 6, 9];
const SCENARIOS: u64 = 60;
/// Number of repetitions; the shortest time counts, so that other load has little influence.
const REPEATS: u32 = 3;
const GOAL_MS: f64 = 1.0;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    let mut all = Vec::new();
    for policy in ["heuristic", "frozen", "random"] {
        let mut times = Vec::new();
        for task in env_core::tasks().filter(|task| task.world().starts_with("kessler")) {
            for level in LEVELS {
                let recipe = Arc::new(Recipe::at_level(task, level)?);
                for seed in 0..SCENARIOS {
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
        all.extend_from_slice(&times);
        rows.push(row(&format!("critique of a kessler episode, run by {policy}"), times, None));
    }
    rows.push(row("critique of a kessler episode, all policies", all, Some(GOAL_MS)));
    Ok(rows)
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
