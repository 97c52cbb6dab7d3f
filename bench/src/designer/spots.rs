//! Four scripted agents with one known weakness each, and a designer that knows of them what a real server has collected: the
//! failure profile of their episodes on random contested scenarios, and, round by round, how they fared on its layouts. How
//! often these make them fail, against random contested scenarios of the same params; and how often with the profile alone.

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, ensure};
use designer::brief::{Brief, Fate, Past};
use designer::kessler::Design;
use designer::kessler::agents::{ALL, Weakness, agent};
use designer::procedural::Procedural;
use designer::{Admitted, Gate, Profile, language};
use env_core::bracket::{self, Bracket, SuccessRule, success};
use env_core::critique::{Critique, Encounter, Verdict};
use env_core::kessler::bearing::Frame;
use env_core::rollout::fly;
use env_core::{Flown, Recipe, Scenario, TaskSpec};
use rayon::prelude::*;
use serde_json::{Value, json};
use system_tests::{Api, Lease, Process, wire};

use crate::Row;

/// The level whose params both sides have.
const LEVEL: u32 = 3;
/// Random contested scenarios.
const SCENARIOS: usize = 400;
/// Layouts, some a round: after each the designer is told how the agent fared.
const ROUNDS: u64 = 25;
const A_ROUND: usize = 8;
/// Fuel spent on burns that are judged wasteful from which the nervous agent has failed, of the 90 that its three satellites
/// have.
const WASTED: f64 = 40.0;
/// How far from the aimed bearing a hit may come from, degrees: the compiler's width and half a sector.
const AIMED: f64 = 30.0;

/// How an agent fared on one scenario.
struct Tried {
    failed: bool,
    succeeded: bool,
    regret: f64,
    critique: Critique,
}

pub(super) fn measure() -> anyhow::Result<Vec<Row>> {
    let runtime = tokio::runtime::Runtime::new()?;
    let mut rows = Vec::new();
    for (name, weakness) in ALL {
        let id = if weakness == Weakness::Nervous { "kessler/eco_station" } else { "kessler/survival" };
        let task = env_core::task(id).context("a task")?;
        let (profile, failed) = runtime.block_on(collected(task, weakness))?;
        rows.extend(row(name, task, weakness, &profile, failed)?);
    }
    Ok(rows)
}

/// The profile that a server collects of an agent on random contested scenarios, and how often it failed.
async fn collected(task: &'static dyn TaskSpec, weakness: Weakness) -> anyhow::Result<(Profile, usize)> {
    let folder = tempfile::tempdir()?;
    let server = Process::start(&folder.path().join("spots.sqlite3"));
    let api = server.api();
    let (columns, row): (Vec<_>, Vec<_>) = task.levels().params(LEVEL as usize).unzip();
    let created = api
        .post(
            "/v1/runs",
            json!({
                "id": "spots", "seed": 1, "placement": false, "contested_share": 1.0, "tasks": [task.id()],
                "task_settings": {task.id(): {"levels": {"columns": columns, "rows": [row]}}},
                "design": {"designer": "off"},
            }),
        )
        .await;
    ensure!(created.status == 201, "no run: {}", created.body);
    let lease = lease(&api).await?;
    let tried: Vec<(Value, bool)> = lease
        .episodes()
        .into_par_iter()
        .map(|(episode, scenario)| {
            let admission = bracket::admit(&scenario);
            let bracket = admission.bracket.context("a bracket")?;
            ensure!(admission.contested, "a scenario that is not contested");
            let (flown, log) = flown(weakness, &scenario)?;
            let tried = judged(weakness, &scenario, &bracket, &flown, task.critique(&scenario, &log)?);
            Ok((json!({"episode": episode, "actions": wire(&log)}), tried.failed))
        })
        .collect::<anyhow::Result<_>>()?;
    let failed = tried.iter().filter(|(_, failed)| *failed).count();
    for batch in tried.chunks(100) {
        let results: Vec<_> = batch.iter().map(|(result, _)| result.clone()).collect();
        api.report("spots", results).await;
    }
    loop {
        let answer = api.get("/v1/runs/spots/failures").await;
        if answer.body["waiting"] == 0 {
            let profile = Profile::read(&answer.body.to_string(), Some(task.id()))?;
            ensure!(profile.criticised == SCENARIOS as u64, "{} were criticised", profile.criticised);
            return Ok((profile, failed));
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

async fn lease(api: &Api) -> anyhow::Result<Lease> {
    for _ in 0..300 {
        let answer = api.post("/v1/runs/spots/leases", json!({"groups": SCENARIOS, "ttl_s": 3600})).await;
        match answer.status {
            201 => return Ok(Lease(answer.body)),
            429 | 503 => tokio::time::sleep(Duration::from_millis(200)).await,
            _ => anyhow::bail!("no lease: {}", answer.body),
        }
    }
    anyhow::bail!("the server prepares too slowly")
}

fn flown(weakness: Weakness, scenario: &Scenario) -> anyhow::Result<(Flown, env_core::ActionLog)> {
    let mut agent = agent(weakness, scenario)?;
    Ok(fly(scenario, &mut *agent)?)
}

fn judged(
    weakness: Weakness,
    scenario: &Scenario,
    bracket: &Bracket,
    flown: &Flown,
    critique: Critique,
) -> Tried {
    let succeeded = success(scenario, SuccessRule::Task, bracket, flown);
    let vain = critique.actions.iter().filter(|action| action.verdict == Verdict::Wasteful);
    let wasted: f64 = vain.map(|action| action.cost).sum();
    // As the service has it.
    let best = bracket.reference.score;
    let gap = if weakness == Weakness::Nervous { best } else { (best - bracket.floor).max(bracket::MIN_GAP) };
    Tried {
        failed: if weakness == Weakness::Nervous { wasted >= WASTED } else { !succeeded },
        succeeded,
        regret: ((best - flown.score) / gap).clamp(0.0, 1.0),
        critique,
    }
}

/// What the designer makes of a profile.
#[derive(Default)]
struct Found {
    admitted: usize,
    failed: usize,
    /// Failed, by the aimed mode.
    of_mode: usize,
    /// The same, hit from where the aim says, where it says so.
    from_there: usize,
}

fn row(
    name: &str,
    task: &'static dyn TaskSpec,
    weakness: Weakness,
    profile: &Profile,
    failed: usize,
) -> anyhow::Result<Vec<Row>> {
    let found = designed(task, weakness, profile, true)?;
    let blind = designed(task, weakness, profile, false)?;
    let baseline = failed as f64 / SCENARIOS as f64;
    let share = found.failed as f64 / found.admitted as f64;
    let wanted = (3.0 * baseline).min(0.9);
    let of_mode = found.of_mode as f64 / found.failed.max(1) as f64;
    let from_there = found.from_there as f64 / found.failed.max(1) as f64;
    Ok(vec![
        Row {
            what: format!("{name}: fails on designed layouts, on random contested scenarios ({})", task.id()),
            measured: format!("{:.1} %, {:.1} %", 100.0 * share, 100.0 * baseline),
            goal: format!("≥ {:.1} %", 100.0 * wanted),
            ratio: Some(share / wanted),
        },
        Row {
            what: format!("{name}: the same with the profile alone, not told how its layouts fared"),
            measured: format!("{:.1} %", 100.0 * blind.failed as f64 / blind.admitted as f64),
            goal: String::new(),
            ratio: None,
        },
        Row {
            what: format!("{name}: of these by the aimed mode; and from the aimed bearing"),
            measured: format!("{:.1} %, {:.1} %", 100.0 * of_mode, 100.0 * from_there),
            goal: "≥ 70 %".into(),
            ratio: Some(of_mode / 0.7),
        },
    ])
}

fn designed(
    task: &'static dyn TaskSpec,
    weakness: Weakness,
    profile: &Profile,
    told: bool,
) -> anyhow::Result<Found> {
    let recipe = Arc::new(Recipe::with_params(task, task.levels().params(LEVEL as usize))?);
    let mut gate = Gate::new(language(task).context("a language")?, Vec::new());
    let mut fates: Vec<Past> = Vec::new();
    let mut found = Found::default();
    for round in 0..ROUNDS {
        // The same params as the random scenarios: nothing for a design to choose.
        let mut brief = Brief::new(Arc::clone(&recipe), A_ROUND, round);
        brief.level = Some(LEVEL);
        brief.profile = profile.clone();
        if told {
            brief.fates = fates.iter().rev().take(3 * A_ROUND).cloned().collect();
        }
        for judged in Procedural::layouts(&brief, &mut gate).judged {
            if let Ok(layout) = judged.verdict {
                fates.push(faced(weakness, &layout, &mut found)?);
            }
        }
    }
    Ok(found)
}

/// Lets the agent fly a layout, and notes how it fared.
fn faced(weakness: Weakness, layout: &Admitted, found: &mut Found) -> anyhow::Result<Past> {
    let scenario = layout.scenario();
    let (flown, log) = flown(weakness, scenario)?;
    let critique = scenario.task().critique(scenario, &log)?;
    let tried = judged(weakness, scenario, layout.bracket(), &flown, critique);
    let thought =
        scenario.recipe().layout().and_then(|layout| layout.provenance.clone()).context("a design")?;
    let design = Design::from_json(&thought)?;
    let of_mode = || tried.critique.failures.iter().filter(|failure| failure.mode == design.aim.mode);
    let there = |met: &Encounter| {
        let bearing = match design.frame {
            Frame::RadialInTrack => Some(met.bearing_deg),
            Frame::Inertial => met.bearing_inertial_deg,
        };
        let off = |aimed: u32| bearing.map(|b| (b - f64::from(aimed) + 540.0).rem_euclid(360.0) - 180.0);
        design.aim.bearing_deg.is_none_or(|aimed| off(aimed).is_some_and(|off| off.abs() <= AIMED))
    };
    let met = |failure: &env_core::critique::Failure| {
        failure.encounter.as_ref().map_or(design.aim.bearing_deg.is_none(), there)
    };
    found.admitted += 1;
    found.failed += usize::from(tried.failed);
    found.of_mode += usize::from(tried.failed && of_mode().next().is_some());
    found.from_there += usize::from(tried.failed && of_mode().any(met));
    let success = if tried.succeeded { 1.0 } else { 0.0 };
    let as_aimed = match tried.critique.failures.is_empty() {
        true => None,
        false => Some(if of_mode().next().is_some() { 1.0 } else { 0.0 }),
    };
    let fate = Fate::Flown { episodes: 1, success, regret: tried.regret, as_aimed, retired: false };
    Ok(Past { design: thought, sky: Some(scenario.seed()), fate })
}
