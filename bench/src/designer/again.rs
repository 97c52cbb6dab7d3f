//! Every admitted layout flown again from its stored bytes by a process of its own, which knows nothing but the file.

use std::io::{BufRead, BufReader, BufWriter, Write};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use anyhow::{Context, ensure};
use designer::procedural::Procedural;
use designer::{Admitted, Brief, Gate, language};
use env_core::log::Precision;
use env_core::rollout::replay;
use env_core::task::StepReport;
use env_core::{ActionLog, JointAction, Recipe, Scenario, Stopped, TaskSpec};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::Row;

/// Layouts flown again.
const LAYOUTS: usize = 2000;
const LEVELS: usize = 10;

pub(super) fn measure() -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("layouts.ndjson");
    let tasks: Vec<&'static dyn TaskSpec> =
        env_core::tasks().filter(|task| language(*task).is_some()).collect();
    let cells: Vec<_> = tasks.iter().flat_map(|task| (0..LEVELS).map(move |level| (*task, level))).collect();
    let each = LAYOUTS.div_ceil(cells.len());
    let admitted: Vec<Admitted> = cells
        .into_par_iter()
        .map(|(task, level)| layouts(task, level, each))
        .collect::<anyhow::Result<Vec<_>>>()?
        .into_iter()
        .flatten()
        .collect();
    let mut out = BufWriter::new(std::fs::File::create(&file)?);
    for layout in &admitted {
        writeln!(out, "{}", stored(layout))?;
    }
    out.flush()?;
    drop(out);
    let answer = Command::new(std::env::current_exe()?).arg("--again").arg(&file).output()?;
    ensure!(answer.status.success(), "{}", String::from_utf8_lossy(&answer.stderr));
    let told: Value = serde_json::from_slice(&answer.stdout)?;
    let (flown, unfair) = (told["flown"].as_u64(), told["unfair"].as_u64());
    ensure!(flown == Some(admitted.len() as u64), "only {flown:?} of {} were flown again", admitted.len());
    Ok(vec![Row {
        what: format!(
            "unfair layouts let through ({} of threats, {} of decoys, {} tasks × {LEVELS} levels), flown again",
            admitted.iter().filter(|layout| layout.claim() == designer::Claim::Threat).count(),
            admitted.iter().filter(|layout| layout.claim() == designer::Claim::Decoy).count(),
            tasks.len(),
        ),
        measured: format!("{} of {}", unfair.unwrap_or(u64::MAX), admitted.len()),
        goal: format!("0 of {LAYOUTS}"),
        ratio: Some(if unfair == Some(0) { admitted.len() as f64 / LAYOUTS as f64 } else { 0.0 }),
    }])
}

/// Layouts of one task and level, for failures of every mode that can be laid out.
fn layouts(task: &'static dyn TaskSpec, level: usize, count: usize) -> anyhow::Result<Vec<Admitted>> {
    let recipe = Arc::new(Recipe::with_params(task, task.levels().params(level))?);
    let mut brief = Brief::new(recipe, count, level as u64).at_level(task.levels(), u32::try_from(level)?);
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
    let mut gate = Gate::new(language(task).context("a language")?, Vec::new());
    let mut admitted = Vec::new();
    for round in 0..10 {
        brief.seed = level as u64 * 1000 + round;
        brief.count = count - admitted.len();
        let designed = Procedural::layouts(&brief, &mut gate);
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

fn stored(layout: &Admitted) -> Value {
    let bracket = layout.bracket();
    json!({
        "scenario": layout.scenario().to_json(),
        "claim": layout.claim().word(),
        "floor": bracket.floor,
        "reference": bracket.reference.score,
        "witness": bracket.witness.encode(),
    })
}

/// What the other process does: flies every layout of the file, and tells how many are not what they claim.
///
/// # Errors
/// A file that cannot be read.
pub(crate) fn check(file: &Path) -> anyhow::Result<Value> {
    let lines: Vec<String> = BufReader::new(std::fs::File::open(file)?).lines().collect::<Result<_, _>>()?;
    let verdicts: Vec<_> = lines.par_iter().map(|line| fair(line)).collect();
    let reasons: Vec<String> =
        verdicts.iter().filter_map(|v| v.as_ref().err()).map(|e| format!("{e:#}")).collect();
    Ok(json!({"flown": lines.len(), "unfair": reasons.len(), "reasons": reasons}))
}

fn fair(line: &str) -> anyhow::Result<()> {
    let layout: Value = serde_json::from_str(line)?;
    let scenario = Scenario::from_json(&layout["scenario"])?;
    let bytes: Vec<u8> = serde_json::from_value(layout["witness"].clone())?;
    let witness = ActionLog::decode(&bytes)?;
    let flown = replay(&scenario, &witness)?;
    let reference = layout["reference"].as_f64().context("a reference")?;
    ensure!(
        flown.score.to_bits() == reference.to_bits(),
        "the witness earns {}, not {reference}",
        flown.score
    );
    let floor = layout["floor"].as_f64().context("a floor")?;
    let gap = reference - floor;
    let skill = (gap >= env_core::bracket::MIN_GAP).then_some(1.0);
    ensure!(scenario.task().success(&flown, skill), "the witness does not succeed");
    let fuel = scenario.recipe().param("fuel").context("fuel")?
        * f64::from(scenario.task().agents(scenario.recipe()));
    ensure!(flown.fuel_used <= fuel + 1e-9, "the witness spends {} of {fuel}", flown.fuel_used);
    let mut holds = ActionLog::new(scenario.task().action_space().columns.len(), Precision::F64);
    holds.stopped = Some(Stopped::TooLate); // whoever says so flies hold to the end
    let held = replay(&scenario, &holds)?;
    match layout["claim"].as_str() {
        Some("threat") => ensure!(held.lost > 0, "who does nothing loses nobody"),
        _ => ensure!(held.lost == 0, "who does nothing loses {}", held.lost),
    }
    early(&scenario)
}

/// Nothing touches before anybody could act.
fn early(scenario: &Scenario) -> anyhow::Result<()> {
    let mut episode = scenario.task().start(scenario)?;
    let mut report = StepReport::default();
    let nobody = JointAction { agents: &[], values: &[] };
    for _ in 0..2 {
        episode.step(nobody, &mut report)?;
    }
    ensure!(episode.flown().lost == 0, "somebody is lost before step 3");
    Ok(())
}
