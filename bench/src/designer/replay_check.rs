//! Replays every admitted layout from its stored bytes in a separate process, which has only the file.

use std::io::{BufRead, BufReader, BufWriter, Write};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use anyhow::{Context, ensure};
use designer::procedural::ProceduralDesigner;
use designer::{AdmittedLayout, DesignBrief, Gate, design_language};
use env_core::log::Precision;
use env_core::rollout::replay;
use env_core::task::StepReport;
use env_core::{ActionLog, JointAction, Recipe, Scenario, StopReason, TaskSpec};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::Row;

/// Number of layouts to replay.
const LAYOUTS: usize = 2000;
const LEVELS: usize = 10;

pub(super) fn measure() -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("layouts.ndjson");
    let tasks: Vec<&'static dyn TaskSpec> =
        env_core::tasks().filter(|task| design_language(*task).is_some()).collect();
    let cells: Vec<_> = tasks.iter().flat_map(|task| (0..LEVELS).map(move |level| (*task, level))).collect();
    let each = LAYOUTS.div_ceil(cells.len());
    let admitted: Vec<AdmittedLayout> = cells
        .into_par_iter()
        .map(|(task, level)| design_layouts(task, level, each))
        .collect::<anyhow::Result<Vec<_>>>()?
        .into_iter()
        .flatten()
        .collect();
    let mut out = BufWriter::new(std::fs::File::create(&file)?);
    for layout in &admitted {
        writeln!(out, "{}", layout_to_json(layout))?;
    }
    out.flush()?;
    drop(out);
    let output = Command::new(std::env::current_exe()?).arg("--replay-check").arg(&file).output()?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let result: Value = serde_json::from_slice(&output.stdout)?;
    let (replayed, unfair) = (result["replayed"].as_u64(), result["unfair"].as_u64());
    ensure!(replayed == Some(admitted.len() as u64), "only {replayed:?} of {} were replayed", admitted.len());
    Ok(vec![Row {
        label: format!(
            "unfair layouts let through ({} of threats, {} of decoys, {} tasks × {LEVELS} levels), replayed",
            admitted.iter().filter(|layout| layout.kind() == designer::LayoutKind::Threat).count(),
            admitted.iter().filter(|layout| layout.kind() == designer::LayoutKind::Decoy).count(),
            tasks.len(),
        ),
        measured: format!("{} of {}", unfair.unwrap_or(u64::MAX), admitted.len()),
        goal: format!("0 of {LAYOUTS}"),
        ratio: Some(if unfair == Some(0) { admitted.len() as f64 / LAYOUTS as f64 } else { 0.0 }),
    }])
}

/// Designs layouts of one task and level for failures of every mode.
fn design_layouts(
    task: &'static dyn TaskSpec,
    level: usize,
    count: usize,
) -> anyhow::Result<Vec<AdmittedLayout>> {
    let recipe = Arc::new(Recipe::at_level(task, level)?);
    let mut brief =
        DesignBrief::new(recipe, count, level as u64).at_level(task.levels(), u32::try_from(level)?);
    for mode in task.failure_modes() {
        let weight = if mode.name == "collision" { 4.0 } else { 2.0 };
        let mode = designer::profile::ModeProfile {
            mode: mode.name.to_owned(),
            count: 1,
            weight,
            ..Default::default()
        };
        brief.profile.modes.push(mode);
    }
    let mut gate = Gate::new(design_language(task).context("a language")?, Vec::new());
    let mut admitted = Vec::new();
    for round in 0..10 {
        brief.seed = level as u64 * 1000 + round;
        brief.count = count - admitted.len();
        let designed = ProceduralDesigner::design_layouts(&brief, &mut gate);
        admitted.extend(designed.judged.into_iter().filter_map(|judged| judged.verdict.ok()));
        if admitted.len() == count {
            break;
        }
    }
    ensure!(
        admitted.len() == count,
        "{} L{level}: only {} layouts were let through",
        task.id(),
        admitted.len()
    );
    Ok(admitted)
}

fn layout_to_json(layout: &AdmittedLayout) -> Value {
    let bracket = layout.bracket();
    json!({
        "scenario": layout.scenario().to_json(),
        "kind": layout.kind().as_str(),
        "floor": bracket.floor,
        "reference": bracket.reference.score,
        "reference_plan": bracket.reference_plan.encode(),
    })
}

/// Replays every layout of the file and reports how many differ from their claims. The other process runs this function.
///
/// # Errors
/// Returns an error if the file cannot be read.
pub(crate) fn check_layouts(file: &Path) -> anyhow::Result<Value> {
    let lines: Vec<String> = BufReader::new(std::fs::File::open(file)?).lines().collect::<Result<_, _>>()?;
    let verdicts: Vec<_> = lines.par_iter().map(|line| check_layout(line)).collect();
    let reasons: Vec<String> =
        verdicts.iter().filter_map(|v| v.as_ref().err()).map(|e| format!("{e:#}")).collect();
    Ok(json!({"replayed": lines.len(), "unfair": reasons.len(), "reasons": reasons}))
}

fn check_layout(line: &str) -> anyhow::Result<()> {
    let layout: Value = serde_json::from_str(line)?;
    let scenario = Scenario::from_json(&layout["scenario"])?;
    let bytes: Vec<u8> = serde_json::from_value(layout["reference_plan"].clone())?;
    let reference_plan = ActionLog::decode(&bytes)?;
    let replayed = replay(&scenario, &reference_plan)?;
    let reference = layout["reference"].as_f64().context("a reference")?;
    ensure!(
        replayed.score.to_bits() == reference.to_bits(),
        "the reference plan scores {}, not {reference}",
        replayed.score
    );
    let floor = layout["floor"].as_f64().context("a floor")?;
    let gap = reference - floor;
    let skill = (gap >= env_core::bracket::MIN_GAP).then_some(1.0);
    ensure!(scenario.task().is_success(&replayed, skill), "the reference plan does not succeed");
    // Only kessler limits fuel.
    if let Some(each) = scenario.recipe().param("fuel") {
        let fuel = each * f64::from(scenario.task().agents(scenario.recipe()));
        let spent = replayed.fuel_used;
        ensure!(spent <= fuel + 1e-9, "the reference plan spends {spent} of {fuel}");
    }
    let mut hold_log = ActionLog::new(scenario.task().action_space().dim(), Precision::F64);
    hold_log.stopped = Some(StopReason::TooLate); // the remaining steps hold
    let held = replay(&scenario, &hold_log)?;
    match layout["kind"].as_str() {
        Some("threat") => ensure!(held.lost > 0, "holding loses no agent"),
        _ => ensure!(held.lost == 0, "holding loses {} agents", held.lost),
    }
    check_first_steps(&scenario)
}

/// Checks that no agent is lost in the first two steps, before an agent could act.
fn check_first_steps(scenario: &Scenario) -> anyhow::Result<()> {
    let mut episode = scenario.task().start(scenario)?;
    let mut report = StepReport::default();
    let no_action = JointAction { agents: &[], values: &[] };
    for _ in 0..2 {
        episode.step(no_action, &mut report)?;
    }
    ensure!(episode.outcome().lost == 0, "an agent is lost before step 3");
    Ok(())
}
