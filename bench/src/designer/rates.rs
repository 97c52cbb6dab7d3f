//! Speed of the designer in kessler: designs compiled and layouts judged, on one thread and on all.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;
use designer::kessler::{Design, compile};
use designer::procedural::ProceduralDesigner;
use designer::{DesignBrief, Gate, design_language};
use env_core::{Recipe, Scenario};
use rayon::prelude::*;

use crate::Row;

const LAYOUTS: usize = 200;
const LEVEL: u32 = 3;
/// Goal of compiled designs a second.
const GOAL_COMPILED: f64 = 20_000.0;
/// Goal of judged layouts a second.
const GOAL_JUDGED: f64 = 200.0;
/// Duration of each measurement of the compiler, in seconds.
const DURATION_S: f64 = 1.0;

/// Design and the scenario that it was compiled into.
struct AdmittedDesign {
    design: Design,
    base: Scenario,
}

/// Layouts that a designer produced and the gate judged.
struct JudgedLayouts {
    judged: usize,
    seconds: f64,
    designs: Vec<AdmittedDesign>,
}

pub(super) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    // The goals are those of kessler, whose compiler needs no simulation.
    for task in env_core::tasks().filter(|task| task.world().starts_with("kessler@")) {
        let recipe = Recipe::at_level(task, LEVEL as usize)?;
        let brief = DesignBrief::new(Arc::new(recipe), LAYOUTS, 11).at_level(task.levels(), LEVEL);
        let single = design_and_judge(&brief)?;
        let start = Instant::now();
        let threads = rayon::current_num_threads();
        let briefs: Vec<_> = (0..threads as u64).map(|seed| DesignBrief { seed, ..brief.clone() }).collect();
        let judged: usize = briefs
            .par_iter()
            .map(|brief| design_and_judge(brief).map(|layouts| layouts.judged))
            .collect::<anyhow::Result<Vec<_>>>()?
            .into_iter()
            .sum();
        let parallel = judged as f64 / start.elapsed().as_secs_f64();
        rows.push(Row {
            label: format!(
                "layouts designed and judged, {} L{LEVEL}: one thread, {threads} threads",
                task.id()
            ),
            measured: format!("{:.0}, {parallel:.0} layouts/s", single.judged as f64 / single.seconds),
            goal: format!("≥ {GOAL_JUDGED} layouts/s"),
            ratio: Some(parallel / GOAL_JUDGED),
        });
        rows.push(measure_compiler(task.id(), &single.designs)?);
    }
    Ok(rows)
}

/// Designs and judges layouts on this thread.
fn design_and_judge(brief: &DesignBrief) -> anyhow::Result<JudgedLayouts> {
    let language = design_language(brief.recipe.task()).context("the task has no design language")?;
    let mut gate = Gate::new(language, Vec::new());
    let start = Instant::now();
    let designed = ProceduralDesigner::design_layouts(brief, &mut gate);
    let seconds = start.elapsed().as_secs_f64();
    let mut designs = Vec::new();
    for admitted in designed.judged.iter().filter_map(|judged| judged.verdict.as_ref().ok()) {
        let layout = admitted.scenario().recipe().layout();
        let design =
            layout.and_then(|layout| layout.provenance.as_ref()).context("the layout has no design")?;
        let base = brief.scenario(admitted.scenario().seed());
        designs.push(AdmittedDesign { design: Design::from_json(design)?, base });
    }
    Ok(JudgedLayouts { judged: designed.judged.len(), seconds, designs })
}

fn measure_compiler(task: &str, designs: &[AdmittedDesign]) -> anyhow::Result<Row> {
    let encounters: usize = designs.iter().map(|admitted| admitted.design.encounters.len()).sum();
    let single = compiled_per_s(designs)?;
    let threads = rayon::current_num_threads();
    let rates = (0..threads).into_par_iter().map(|_| compiled_per_s(designs));
    let parallel: f64 = rates.collect::<anyhow::Result<Vec<_>>>()?.into_iter().sum();
    Ok(Row {
        label: format!(
            "designs compiled, {task} L{LEVEL}, {:.1} encounters each: one thread, {threads} threads",
            encounters as f64 / designs.len().max(1) as f64
        ),
        measured: format!("{single:.0}, {parallel:.0} designs/s"),
        goal: format!("≥ {GOAL_COMPILED} designs/s"),
        ratio: Some(parallel / GOAL_COMPILED),
    })
}

/// Measures designs compiled a second on this thread.
fn compiled_per_s(designs: &[AdmittedDesign]) -> anyhow::Result<f64> {
    let (mut compiled, start) = (0.0, Instant::now());
    while start.elapsed().as_secs_f64() < DURATION_S && !designs.is_empty() {
        for AdmittedDesign { design, base } in designs {
            std::hint::black_box(compile(design, base)?);
        }
        compiled += designs.len() as f64;
    }
    Ok(compiled / start.elapsed().as_secs_f64())
}
