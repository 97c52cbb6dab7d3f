//! How fast designs are compiled, and layouts judged, on one thread.

use std::sync::Arc;
use std::time::Instant;

use designer::kessler::{Design, compile};
use designer::procedural::Procedural;
use designer::{Brief, Gate, language};
use env_core::{Recipe, Scenario};

use crate::Row;

const LAYOUTS: usize = 200;
const LEVEL: u32 = 3;
const COMPILED: f64 = 20_000.0;
const JUDGED: f64 = 200.0;
/// How long each compiler is timed, seconds.
const TIMED: f64 = 1.0;

pub(super) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for task in env_core::tasks().filter(|task| language(*task).is_some()) {
        let recipe = Recipe::with_params(task, task.levels().params(LEVEL as usize))?;
        let brief = Brief::new(Arc::new(recipe), LAYOUTS, 11).at_level(task.levels(), LEVEL);
        let Some(language) = language(task) else { continue };
        let mut gate = Gate::new(language, Vec::new());
        let start = Instant::now();
        let designed = Procedural::layouts(&brief, &mut gate);
        let judged = designed.judged.len() as f64 / start.elapsed().as_secs_f64();
        rows.push(Row {
            what: format!("layouts thought of and judged, {} L{LEVEL}, one thread", task.id()),
            measured: format!("{judged:.0} layouts/s"),
            goal: format!("≥ {JUDGED} layouts/s"),
            ratio: Some(judged / JUDGED),
        });
        let mut designs = Vec::new();
        for admitted in designed.judged.iter().filter_map(|judged| judged.verdict.as_ref().ok()) {
            let layout = admitted.scenario().recipe().layout();
            if let Some(thought) = layout.and_then(|layout| layout.provenance.as_ref()) {
                designs.push((Design::from_json(thought)?, brief.under(admitted.scenario().seed())));
            }
        }
        rows.push(compiled(task.id(), &designs)?);
    }
    Ok(rows)
}

fn compiled(task: &str, designs: &[(Design, Scenario)]) -> anyhow::Result<Row> {
    let encounters: usize = designs.iter().map(|(design, _)| design.encounters.len()).sum();
    let (mut done, start) = (0.0, Instant::now());
    while start.elapsed().as_secs_f64() < TIMED && !designs.is_empty() {
        for (design, sky) in designs {
            std::hint::black_box(compile(design, sky)?);
        }
        done += designs.len() as f64;
    }
    let rate = done / start.elapsed().as_secs_f64();
    Ok(Row {
        what: format!(
            "designs compiled, {task} L{LEVEL}, {:.1} encounters each, one thread",
            encounters as f64 / designs.len().max(1) as f64
        ),
        measured: format!("{rate:.0} designs/s"),
        goal: format!("≥ {COMPILED} designs/s"),
        ratio: Some(rate / COMPILED),
    })
}
