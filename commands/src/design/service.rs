//! Reads the settings, failures, mastery and layouts of a run from a service.

use anyhow::Context;
use api_types::{
    DesignPage, DesignState, Layout, RunMastery, RunSampler, RungKind, TaskMastery, TaskSampler,
};
use curriculum::{Settings, TaskPlan};
use designer::FailureProfile;
use designer::brief::{DesignRung, LayoutOutcome, LevelMastery, PastLayout};
use env_core::Seed;
use serde::Deserialize;
use serde_json::Value;

use super::brief::{DEFAULT_LEVEL, RunSnapshot, TaskSnapshot};
use crate::api::{ApiClient, find_run};

/// Largest number of listed designs of a run, including those that the gate refused.
const MAX_LISTED_DESIGNS: usize = 500;
/// Largest number of earlier layouts in a brief.
const MAX_PAST_LAYOUTS: usize = 24;

/// Settings of a run that a design brief depends on.
#[derive(Debug, Deserialize)]
struct DesignedRun {
    curriculum: Settings,
}

/// Returns the results of a run's newest layouts of a task, the newest first. Designers learn from them, and new layouts must
/// differ from them.
///
/// # Errors
/// Returns the errors of [`fetch_run`].
pub(super) async fn past_layouts(api: &ApiClient, run: &str, task: &str) -> anyhow::Result<Vec<PastLayout>> {
    let page: DesignPage =
        api.get(&format!("/v1/runs/{run}/designs?task={task}&limit={MAX_LISTED_DESIGNS}")).await?;
    let known = env_core::task(task);
    let mut past = Vec::new();
    for head in
        page.designs.into_iter().filter(|head| head.state != DesignState::Refused).take(MAX_PAST_LAYOUTS)
    {
        let layout: Layout = api.get(&format!("/v1/layouts/{}", head.id)).await?;
        let Some(design) = layout.design else { continue };
        let sky = layout.scenario.get("seed").and_then(Value::as_u64).and_then(|seed| Seed::new(seed).ok());
        let rung = known.map_or_else(DesignRung::default, |known| {
            DesignRung::from_stored(known, head.level, head.start_rung)
        });
        let fate = match (head.results.success, head.results.regret) {
            (Some(success), Some(regret)) => LayoutOutcome::Evaluated {
                episodes: u32::try_from(head.results.episodes).unwrap_or(u32::MAX),
                success_rate: success,
                regret,
                aimed_share: head.results.as_aimed,
                is_retired: head.state == DesignState::Retired,
            },
            _ => LayoutOutcome::Untested,
        };
        past.push(PastLayout { design, rung, seed: sky, outcome: fate });
    }
    Ok(past)
}

/// Level to design for: the one that the run is at. A sampler has none; the level at which it proposes most takes its place, unless
/// its rungs are starts.
fn current_level(plan: &TaskPlan, mastery: &TaskMastery, sampler: Option<&TaskSampler>) -> u32 {
    let of_levels = sampler.filter(|sampler| sampler.kind == Some(RungKind::Level));
    let rungs = of_levels.map_or(&[][..], |sampler| &sampler.rungs);
    let likeliest = rungs.iter().filter(|rung| rung.probability.is_some()).max_by(|a, b| {
        a.probability.unwrap_or(0.0).total_cmp(&b.probability.unwrap_or(0.0)).then(b.rung.cmp(&a.rung))
    });
    let sampled = likeliest.map(|rung| rung.rung);
    mastery.level.or(mastery.probe_level).or(sampled).unwrap_or(DEFAULT_LEVEL).min(plan.hardest_level())
}

/// Fetches the settings, levels, mastery and failures of a run.
///
/// # Errors
/// Returns an error if the service cannot be reached, has no such run, or sends an unexpected response. The message says how
/// to fix it.
pub(super) async fn fetch_run(api: &ApiClient, run: &str) -> anyhow::Result<RunSnapshot> {
    let summary = find_run(api, Some(run)).await.context("--run")?;
    let run = summary.id;
    let settings: DesignedRun =
        serde_json::from_value(summary.settings).context("the settings of the run")?;
    let mastery: RunMastery = api.get(&format!("/v1/runs/{run}/mastery")).await?;
    let samplers: RunSampler = api.get(&format!("/v1/runs/{run}/sampler?points=1")).await?;
    let failures = api.get_text(&format!("/v1/runs/{run}/failure_profiles?examples=0")).await?;
    let mut tasks = Vec::new();
    for plan in settings.curriculum.tasks {
        let profile =
            FailureProfile::parse(&failures, Some(&plan.task)).context("the failure profiles of the run")?;
        let mastery = mastery.tasks.iter().find(|mastery| mastery.task == plan.task);
        let sampler = samplers.tasks.iter().find(|sampler| sampler.task == plan.task);
        let level = mastery.map(|known| current_level(&plan, known, sampler));
        let mastery = mastery.and_then(|mastery| mastery.mastery.as_ref()).filter(|known| known.n > 0);
        let mastery = mastery.map(|m| LevelMastery { n: m.n, mean: m.mean, q10: m.q10, q90: m.q90 });
        tasks.push(TaskSnapshot { plan, level, mastery, profile });
    }
    Ok(RunSnapshot { run: Some(run), tasks })
}
