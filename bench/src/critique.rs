//! The critique of finished episodes, one thread: built-in policies over every task at easy, middling and hard levels.

use std::sync::Arc;
use std::time::Instant;

use env_core::rollout::fly;
use env_core::{Recipe, Scenario, Seed};

use crate::Row;

const LEVELS: [usize; 4] = [0, 3, 6, 9];
const SCENARIOS: u64 = 60;
const GOAL_MS: f64 = 1.0;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    let mut all = Vec::new();
    for policy in ["heuristic", "frozen", "random"] {
        let mut times = Vec::new();
        for task in env_core::tasks().filter(|task| task.world().starts_with("kessler")) {
            for level in LEVELS {
                let recipe = Arc::new(Recipe::with_params(task, task.levels().params(level))?);
                for seed in 0..SCENARIOS {
                    let scenario = Scenario::new(Arc::clone(&recipe), Seed::user(seed)?);
                    let mut pilot = task.policy(policy, &scenario, seed)?;
                    let (_, log) = fly(&scenario, &mut *pilot)?;
                    let start = Instant::now();
                    std::hint::black_box(task.critique(&scenario, &log)?);
                    times.push(start.elapsed().as_secs_f64() * 1e3);
                }
            }
        }
        all.extend_from_slice(&times);
        rows.push(row(&format!("critique of a kessler episode, flown by {policy}"), times, None));
    }
    rows.push(row("critique of a kessler episode, all of these", all, Some(GOAL_MS)));
    Ok(rows)
}

fn row(what: &str, mut times: Vec<f64>, goal: Option<f64>) -> Row {
    times.sort_by(f64::total_cmp);
    let mean = times.iter().sum::<f64>() / times.len() as f64;
    let p99 = times[times.len() * 99 / 100];
    Row {
        what: what.to_owned(),
        measured: format!("{mean:.3} ms mean, {p99:.2} p99"),
        goal: goal.map_or_else(String::new, |goal| format!("≤ {goal} ms mean")),
        ratio: goal.map(|goal| goal / mean),
    }
}
