//! Failure rates of four scripted agents, each with one known weakness, on designed layouts and on random contested scenarios
//! with the same params.
//!
//! The designer knows what a real server collects: the failure profile of the agent on random contested scenarios and, round
//! by round, the results of its layouts. A second measurement gives it the profile only.

use std::sync::Arc;

use anyhow::{Context, ensure};
use designer::brief::{DesignBrief, DesignRung, LayoutOutcome, PastLayout};
use designer::kessler::Design;
use designer::kessler::agents::{Weakness, agent};
use designer::procedural::ProceduralDesigner;
use designer::{AdmittedLayout, FailureProfile, Gate, design_language};
use env_core::admission;
use env_core::admission::{SuccessRule, is_success};
use env_core::bracket::{self, Bracket};
use env_core::critique::{Critique, Encounter, Verdict};
use env_core::kessler::bearing::BearingFrame;
use env_core::rollout::{Rollout, roll_out};
use env_core::{EpisodeOutcome, Recipe, Scenario, TaskSpec};
use rayon::prelude::*;
use serde_json::{Value, json};
use system_tests::{ServerProcess, log_to_json, wait_for};

use crate::Row;

/// Level whose params all scenarios and layouts have.
const LEVEL: u32 = 3;
/// Number of random contested scenarios.
const SCENARIOS: usize = 400;
/// Number of rounds; the designer gets the results after each.
const ROUNDS: u64 = 25;
/// Layouts of a round.
const LAYOUTS_PER_ROUND: usize = 8;
/// Fuel for wasteful burns from which on the nervous agent has failed, of the 90 units of its three satellites.
const FAILURE_FUEL: f64 = 40.0;
/// Largest difference between the aimed bearing and that of a hit, in degrees: the compiler's width and half a sector.
const MAX_BEARING_ERROR_DEG: f64 = 30.0;

/// Scripted agent and the task that it runs.
struct Agent {
    name: &'static str,
    task: &'static dyn TaskSpec,
    weakness: Weakness,
}

/// Result of an agent on one scenario.
struct AgentResult {
    failed: bool,
    succeeded: bool,
    regret: f64,
    critique: Critique,
}

pub(super) fn measure() -> anyhow::Result<Vec<Row>> {
    let runtime = tokio::runtime::Runtime::new()?;
    let mut rows = Vec::new();
    for weakness in Weakness::ALL {
        let name = weakness.name();
        let id = if weakness == Weakness::Nervous { "kessler/eco_station" } else { "kessler/survival" };
        let task = env_core::task(id).context("a task")?;
        let agent = Agent { name, task, weakness };
        let collected = runtime.block_on(collect_profile(&agent))?;
        rows.extend(measure_agent(&agent, &collected)?);
    }
    Ok(rows)
}

/// Failure profile that a server collected, and the number of failures.
struct CollectedProfile {
    profile: FailureProfile,
    failures: usize,
}

/// Runs an agent on random contested scenarios and returns the failure profile that a server collects.
async fn collect_profile(&Agent { task, weakness, .. }: &Agent) -> anyhow::Result<CollectedProfile> {
    let folder = tempfile::tempdir()?;
    let server = ServerProcess::start(&folder.path().join("weaknesses.sqlite3"));
    let api = server.api();
    let (columns, row): (Vec<_>, Vec<_>) = task.levels().params(LEVEL as usize).unzip();
    let created = api
        .post(
            "/v1/runs",
            json!({
                "id": "weaknesses", "seed": 1, "placement": false, "contested_share": 1.0, "tasks": [task.id()],
                "task_settings": {task.id(): {"levels": {"columns": columns, "rows": [row]}}},
                "design": {"designer": "off"},
            }),
        )
        .await;
    ensure!(created.status == 201, "no run: {}", created.body);
    let lease = api.lease("weaknesses", json!({"groups": SCENARIOS, "ttl_s": 3600})).await;
    let results: Vec<(Value, bool)> = lease
        .episodes()
        .into_par_iter()
        .map(|(episode, scenario)| {
            let admission = admission::admit(&scenario);
            let bracket = admission.bracket.context("a bracket")?;
            ensure!(admission.contested, "a leased scenario is not contested");
            let (outcome, log) = run_agent(weakness, &scenario)?;
            let critique = task.critique(&scenario, &log)?;
            let result = judge_result(weakness, &scenario, &bracket, &outcome, critique);
            Ok((json!({"episode": episode, "actions": log_to_json(&log)}), result.failed))
        })
        .collect::<anyhow::Result<_>>()?;
    let failures = results.iter().filter(|(_, failed)| *failed).count();
    for batch in results.chunks(100) {
        let results: Vec<_> = batch.iter().map(|(result, _)| result.clone()).collect();
        api.report("weaknesses", results).await;
    }
    let profiles = wait_for("every episode has its critique", async || {
        let response = api.get("/v1/runs/weaknesses/failure_profiles").await;
        (response.body["waiting"] == 0).then_some(response.body)
    });
    let profile = FailureProfile::parse(&profiles.await.to_string(), Some(task.id()))?;
    ensure!(profile.criticised == SCENARIOS as u64, "{} episodes have a critique", profile.criticised);
    Ok(CollectedProfile { profile, failures })
}

fn run_agent(
    weakness: Weakness,
    scenario: &Scenario,
) -> anyhow::Result<(EpisodeOutcome, env_core::ActionLog)> {
    let mut agent = agent(weakness, scenario)?;
    let Rollout { outcome, log } = roll_out(scenario, &mut *agent)?;
    Ok((outcome, log))
}

fn judge_result(
    weakness: Weakness,
    scenario: &Scenario,
    bracket: &Bracket,
    outcome: &EpisodeOutcome,
    critique: Critique,
) -> AgentResult {
    let succeeded = is_success(scenario, SuccessRule::Task, bracket, outcome);
    let wasteful = critique.actions.iter().filter(|action| action.verdict == Verdict::Wasteful);
    let wasted: f64 = wasteful.map(|action| action.cost).sum();
    // The regret, as the server computes it.
    let best = bracket.reference.score;
    let gap = if weakness == Weakness::Nervous { best } else { (best - bracket.floor).max(bracket::MIN_GAP) };
    AgentResult {
        failed: if weakness == Weakness::Nervous { wasted >= FAILURE_FUEL } else { !succeeded },
        succeeded,
        regret: ((best - outcome.score) / gap).clamp(0.0, 1.0),
        critique,
    }
}

/// Counts over the layouts of a designer.
#[derive(Default)]
struct LayoutCounts {
    admitted: usize,
    failed: usize,
    /// Failures with the aimed mode.
    with_mode: usize,
    /// Failures with the aimed mode and, if the aim has one, the aimed bearing.
    from_bearing: usize,
}

fn measure_agent(agent: &Agent, collected: &CollectedProfile) -> anyhow::Result<Vec<Row>> {
    let Agent { name, task, .. } = *agent;
    let counts = measure_layouts(agent, &collected.profile, true)?;
    let without_results = measure_layouts(agent, &collected.profile, false)?;
    let baseline = collected.failures as f64 / SCENARIOS as f64;
    let share = counts.failed as f64 / counts.admitted as f64;
    let goal = (3.0 * baseline).min(0.9);
    let with_mode = counts.with_mode as f64 / counts.failed.max(1) as f64;
    let from_bearing = counts.from_bearing as f64 / counts.failed.max(1) as f64;
    Ok(vec![
        Row {
            label: format!(
                "{name}: failure rate on designed layouts, on random contested scenarios ({})",
                task.id()
            ),
            measured: format!("{:.1} %, {:.1} %", 100.0 * share, 100.0 * baseline),
            goal: format!("≥ {:.1} %", 100.0 * goal),
            ratio: Some(share / goal),
        },
        Row {
            label: format!("{name}: the same with the profile only, without results of its layouts"),
            measured: format!(
                "{:.1} %",
                100.0 * without_results.failed as f64 / without_results.admitted as f64
            ),
            goal: String::new(),
            ratio: None,
        },
        Row {
            label: format!("{name}: share of failures with the aimed mode; also with the aimed bearing"),
            measured: format!("{:.1} %, {:.1} %", 100.0 * with_mode, 100.0 * from_bearing),
            goal: "≥ 70 %".into(),
            ratio: Some(with_mode / 0.7),
        },
    ])
}

/// Designs layouts for the profile round by round and runs the agent on them.
fn measure_layouts(
    &Agent { task, weakness, .. }: &Agent,
    profile: &FailureProfile,
    with_results: bool,
) -> anyhow::Result<LayoutCounts> {
    let recipe = Arc::new(Recipe::at_level(task, LEVEL as usize)?);
    let mut gate = Gate::new(design_language(task).context("a language")?, Vec::new());
    let mut past_layouts: Vec<PastLayout> = Vec::new();
    let mut counts = LayoutCounts::default();
    for round in 0..ROUNDS {
        // The same params as the random scenarios, so that a design cannot choose them.
        let mut brief = DesignBrief::new(Arc::clone(&recipe), LAYOUTS_PER_ROUND, round);
        brief.level = Some(LEVEL);
        brief.profile = profile.clone();
        if with_results {
            brief.past_layouts = past_layouts.iter().rev().take(3 * LAYOUTS_PER_ROUND).cloned().collect();
        }
        for judged in ProceduralDesigner::design_layouts(&brief, &mut gate).judged {
            if let Ok(layout) = judged.verdict {
                past_layouts.push(run_on_layout(weakness, &layout, &mut counts)?);
            }
        }
    }
    Ok(counts)
}

/// Runs the agent on a layout and adds the result to the counts.
fn run_on_layout(
    weakness: Weakness,
    layout: &AdmittedLayout,
    counts: &mut LayoutCounts,
) -> anyhow::Result<PastLayout> {
    let scenario = layout.scenario();
    let (outcome, log) = run_agent(weakness, scenario)?;
    let critique = scenario.task().critique(scenario, &log)?;
    let result = judge_result(weakness, scenario, layout.bracket(), &outcome, critique);
    let design_json =
        scenario.recipe().layout().and_then(|layout| layout.provenance.clone()).context("a design")?;
    let design = Design::from_json(&design_json)?;
    let failures_with_mode =
        || result.critique.failures.iter().filter(|failure| failure.mode == design.aim.mode);
    let has_aimed_bearing = |encounter: &Encounter| {
        let bearing = match design.frame {
            BearingFrame::RadialInTrack => Some(encounter.bearing_deg),
            BearingFrame::Inertial => encounter.bearing_inertial_deg,
        };
        let error_deg =
            |aimed: u32| bearing.map(|b| (b - f64::from(aimed) + 540.0).rem_euclid(360.0) - 180.0);
        design
            .aim
            .bearing_deg
            .is_none_or(|aimed| error_deg(aimed).is_some_and(|error| error.abs() <= MAX_BEARING_ERROR_DEG))
    };
    let is_aimed = |failure: &env_core::critique::Failure| {
        failure.encounter.as_ref().map_or(design.aim.bearing_deg.is_none(), has_aimed_bearing)
    };
    counts.admitted += 1;
    counts.failed += usize::from(result.failed);
    counts.with_mode += usize::from(result.failed && failures_with_mode().next().is_some());
    counts.from_bearing += usize::from(result.failed && failures_with_mode().any(is_aimed));
    let success_rate = if result.succeeded { 1.0 } else { 0.0 };
    let aimed_share = match result.critique.failures.is_empty() {
        true => None,
        false => Some(if failures_with_mode().next().is_some() { 1.0 } else { 0.0 }),
    };
    let outcome = LayoutOutcome::Evaluated {
        episodes: 1,
        success_rate,
        regret: result.regret,
        aimed_share,
        is_retired: false,
    };
    let rung = DesignRung { level: Some(LEVEL), start_scale: None };
    Ok(PastLayout { design: design_json, rung, seed: Some(scenario.seed()), outcome })
}
