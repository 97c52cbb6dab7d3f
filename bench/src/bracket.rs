//! Brackets of scenarios on one thread: panel, floor, reference and its plan.

use std::sync::Arc;
use std::time::Instant;

use env_core::{Recipe, Scenario, Seed};

use crate::Row;

const SCENARIOS: u64 = 3000;

/// Task and params of a measurement, with the goal.
struct BracketCase {
    task: &'static str,
    params: &'static [(&'static str, f64)],
    goal_ms: f64,
}

impl BracketCase {
    const fn new(task: &'static str, params: &'static [(&'static str, f64)], goal_ms: f64) -> Self {
        Self { task, params, goal_ms }
    }
}

const CASES: [BracketCase; 9] = [
    BracketCase::new("kessler/survival", &[("debris", 50.0)], 0.5),
    BracketCase::new("kessler/survival", &[("debris", 50.0), ("spread", 1.0), ("fuel", 20.0)], 0.5),
    BracketCase::new("kessler/eco_station", &[("debris", 50.0)], 0.5),
    BracketCase::new("kessler/rendezvous", &[("debris", 50.0)], 1.0),
    BracketCase::new("kessler/formation", &[("debris", 50.0)], 5.0),
    BracketCase::new("docking/multiagent", &[("deputies", 3.0)], 5.0),
    BracketCase::new("tasking/scanning", &[("battery_wh", 200.0)], 40.0),
    BracketCase::new("tasking/imaging", &[("targets", 1250.0)], 100.0),
    BracketCase::new("tasking/constellation", &[("satellites", 3.0)], 100.0),
];

/// Cases with `risk: pc`, where every passage of every body counts: easy ones, and the hardest that the API accepts.
const PC_CASES: [BracketCase; 4] = [
    BracketCase::new("kessler/survival", &[("debris", 150.0), ("spread", 1.0)], 300.0),
    BracketCase::new("kessler/survival", &[("debris", 150.0), ("spread", 1.0), ("sigma", 10.0)], 300.0),
    BracketCase::new("kessler/survival", &[("debris", 1000.0), ("spread", 1.0), ("sigma", 10.0)], 300.0),
    BracketCase::new("kessler/formation", &[("debris", 1000.0), ("spread", 1.0)], 300.0),
];
const PC_SCENARIOS: u64 = 5;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for case in &CASES {
        let scenarios = match case.goal_ms {
            10.0.. => SCENARIOS / 100,
            1.0.. => SCENARIOS / 10,
            _ => SCENARIOS,
        };
        rows.push(measure_case(case, scenarios, None)?);
    }
    for case in &PC_CASES {
        rows.push(measure_case(case, PC_SCENARIOS, Some(PhysicsChoice { option: "risk", choice: "pc" }))?);
    }
    Ok(rows)
}

/// Physics option of a recipe that differs from its default.
#[derive(Clone, Copy)]
struct PhysicsChoice {
    option: &'static str,
    choice: &'static str,
}

fn measure_case(case: &BracketCase, scenarios: u64, physics: Option<PhysicsChoice>) -> anyhow::Result<Row> {
    let BracketCase { task, params, goal_ms } = *case;
    let spec = env_core::task(task).ok_or_else(|| anyhow::anyhow!("task {task} does not exist"))?;
    let mut recipe = Recipe::with_params(spec, params.iter().copied())?;
    let mut description: Vec<String> = params.iter().map(|(n, v)| format!("{n} {v}")).collect();
    if let Some(PhysicsChoice { option, choice }) = physics {
        recipe = recipe.with_option(option, choice)?;
        description.push(format!("{option}: {choice}"));
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
        label: format!("bracket, {task} at {}", description.join(", ")),
        measured: format!("{mean:.3} ms mean, {p99:.2} p99"),
        goal: format!("≤ {goal_ms} ms mean"),
        ratio: Some(goal_ms / mean),
    })
}
