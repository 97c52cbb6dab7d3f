//! How fast designs are compiled, and layouts judged, on one thread and on all.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;
use designer::kessler::{Design, compile};
use designer::procedural::Procedural;
use designer::{Brief, Gate, language};
use env_core::{Recipe, Scenario};
use rayon::prelude::*;

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
        let (alone, designs) = judged(&brief)?;
        let start = Instant::now();
        let threads = rayon::current_num_threads();
        let briefs: Vec<_> = (0..threads as u64).map(|seed| Brief { seed, ..brief.clone() }).collect();
        let all: usize = briefs
            .par_iter()
            .map(|brief| judged(brief).map(|((judged, _), _)| judged))
            .collect::<anyhow::Result<Vec<_>>>()?
            .into_iter()
            .sum();
        let together = all as f64 / start.elapsed().as_secs_f64();
        rows.push(Row {
            what: format!(
                "layouts thought of and judged, {} L{LEVEL}: one thread, {threads} threads",
                task.id()
            ),
            measured: format!("{:.0}, {together:.0} layouts/s", alone.0 as f64 / alone.1),
            goal: format!("≥ {JUDGED} layouts/s"),
            ratio: Some(together / JUDGED),
        });
        rows.push(compiled(task.id(), &designs)?);
    }
    Ok(rows)
}

/// A design and the sky it was put into.
type Thought = (Design, Scenario);

/// Layouts judged, in how many seconds; and the designs that passed.
fn judged(brief: &Brief) -> anyhow::Result<((usize, f64), Vec<Thought>)> {
    let language = language(brief.base.task()).context("a language")?;
    let mut gate = Gate::new(language, Vec::new());
    let start = Instant::now();
    let designed = Procedural::layouts(brief, &mut gate);
    let took = start.elapsed().as_secs_f64();
    let mut designs = Vec::new();
    for admitted in designed.judged.iter().filter_map(|judged| judged.verdict.as_ref().ok()) {
        let layout = admitted.scenario().recipe().layout();
        let thought = layout.and_then(|layout| layout.provenance.as_ref()).context("a design")?;
        designs.push((Design::from_json(thought)?, brief.under(admitted.scenario().seed())));
    }
    Ok(((designed.judged.len(), took), designs))
}

fn compiled(task: &str, designs: &[Thought]) -> anyhow::Result<Row> {
    let encounters: usize = designs.iter().map(|(design, _)| design.encounters.len()).sum();
    let one = rate(designs)?;
    let threads = rayon::current_num_threads();
    let rates = (0..threads).into_par_iter().map(|_| rate(designs)).collect::<anyhow::Result<Vec<_>>>()?;
    let together: f64 = rates.into_iter().sum();
    Ok(Row {
        what: format!(
            "designs compiled, {task} L{LEVEL}, {:.1} encounters each: one thread, {threads} threads",
            encounters as f64 / designs.len().max(1) as f64
        ),
        measured: format!("{one:.0}, {together:.0} designs/s"),
        goal: format!("≥ {COMPILED} designs/s"),
        ratio: Some(together / COMPILED),
    })
}

/// Designs compiled a second, on this thread.
fn rate(designs: &[Thought]) -> anyhow::Result<f64> {
    let (mut done, start) = (0.0, Instant::now());
    while start.elapsed().as_secs_f64() < TIMED && !designs.is_empty() {
        for (design, sky) in designs {
            std::hint::black_box(compile(design, sky)?);
        }
        done += designs.len() as f64;
    }
    Ok(done / start.elapsed().as_secs_f64())
}
