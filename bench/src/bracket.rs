//! The bracket: panel, floor, reference and witness of a scenario, one thread.

use std::sync::Arc;
use std::time::Instant;

use env_core::{Recipe, Scenario, Seed};

use crate::Row;

const SCENARIOS: u64 = 3000;

/// Task, params, goal in milliseconds.
type Cell = (&'static str, &'static [(&'static str, f64)], f64);

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    let cells: [Cell; 5] = [
        ("kessler/survival", &[("debris", 50.0)], 0.5),
        ("kessler/survival", &[("debris", 50.0), ("spread", 1.0), ("fuel", 20.0)], 0.5),
        ("kessler/eco_station", &[("debris", 50.0)], 0.5),
        ("kessler/rendezvous", &[("debris", 50.0)], 5.0),
        ("docking/multiagent", &[("deputies", 3.0)], 5.0),
    ];
    for (task, params, goal_ms) in cells {
        let spec = env_core::task(task).ok_or_else(|| anyhow::anyhow!("{task} is gone"))?;
        let recipe = Arc::new(Recipe::with_params(spec, params.iter().copied())?);
        let mut times = Vec::new();
        for seed in 0..if goal_ms > 1.0 { SCENARIOS / 10 } else { SCENARIOS } {
            let scenario = Scenario::new(Arc::clone(&recipe), Seed::user(seed)?);
            let start = Instant::now();
            std::hint::black_box(spec.bracket(&scenario)?);
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        let mean = times.iter().sum::<f64>() / times.len() as f64;
        let p99 = times[times.len() * 99 / 100];
        let named: Vec<String> = params.iter().map(|(n, v)| format!("{n} {v}")).collect();
        rows.push(Row {
            what: format!("bracket, {task} at {}", named.join(", ")),
            measured: format!("{mean:.3} ms mean, {p99:.2} p99"),
            goal: format!("≤ {goal_ms} ms mean"),
            ratio: Some(goal_ms / mean),
        });
    }
    Ok(rows)
}
