//! The bracket: panel, floor, reference and witness of a scenario, one thread.

use std::sync::Arc;
use std::time::Instant;

use env_core::{Recipe, Scenario, Seed};

use crate::Row;

const SCENARIOS: u64 = 3000;

/// Task, params, goal in milliseconds.
type Cell = (&'static str, &'static [(&'static str, f64)], f64);

/// The same under `risk: pc`, where every passage of every body counts: easy, and as hard as can be asked by hand.
const AT_RISK: [Cell; 4] = [
    ("kessler/survival", &[("debris", 150.0), ("spread", 1.0)], 1000.0),
    ("kessler/survival", &[("debris", 150.0), ("spread", 1.0), ("sigma", 10.0)], 1000.0),
    ("kessler/survival", &[("debris", 1000.0), ("spread", 1.0), ("sigma", 10.0)], 5000.0),
    ("kessler/formation", &[("debris", 1000.0), ("spread", 1.0)], 5000.0),
];
const SCENARIOS_AT_RISK: u64 = 5;

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
        let scenarios = if goal_ms > 1.0 { SCENARIOS / 10 } else { SCENARIOS };
        rows.push(row((task, params, goal_ms), scenarios, None)?);
    }
    for cell in AT_RISK {
        rows.push(row(cell, SCENARIOS_AT_RISK, Some(("risk", "pc")))?);
    }
    Ok(rows)
}

fn row((task, params, goal_ms): Cell, scenarios: u64, option: Option<(&str, &str)>) -> anyhow::Result<Row> {
    let spec = env_core::task(task).ok_or_else(|| anyhow::anyhow!("{task} is gone"))?;
    let mut recipe = Recipe::with_params(spec, params.iter().copied())?;
    let mut named: Vec<String> = params.iter().map(|(n, v)| format!("{n} {v}")).collect();
    if let Some((name, choice)) = option {
        recipe = recipe.with_option(name, choice)?;
        named.push(format!("{name}: {choice}"));
    }
    let recipe = Arc::new(recipe);
    let mut times = Vec::new();
    for seed in 0..scenarios {
        let scenario = Scenario::new(Arc::clone(&recipe), Seed::user(seed)?);
        let start = Instant::now();
        std::hint::black_box(spec.bracket(&scenario)?);
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    let mean = times.iter().sum::<f64>() / times.len() as f64;
    let p99 = times[times.len() * 99 / 100];
    Ok(Row {
        what: format!("bracket, {task} at {}", named.join(", ")),
        measured: format!("{mean:.3} ms mean, {p99:.2} p99"),
        goal: format!("≤ {goal_ms} ms mean"),
        ratio: Some(goal_ms / mean),
    })
}
