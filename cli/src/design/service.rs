//! Reads the settings, failures, mastery and layouts of a run from a service.

use std::time::Duration;

use anyhow::{Context, anyhow, bail, ensure};
use api_types::{DesignPage, DesignState, Layout, ProblemDetails, Run, RunMastery};
use designer::FailureProfile;
use designer::brief::{LayoutOutcome, LevelMastery, PastLayout};
use env_core::Seed;
use llm::http_client_builder;
use orchestrator::runs::settings::RunSettings;
use reqwest::Client;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::brief::{RunSnapshot, TaskSnapshot};

/// Timeout of one request.
const TIMEOUT: Duration = Duration::from_secs(30);
/// Largest number of listed designs of a run, including those that the gate refused.
const MAX_LISTED_DESIGNS: usize = 500;
/// Largest number of earlier layouts in a brief.
const MAX_PAST_LAYOUTS: usize = 24;

fn client(url: &str) -> anyhow::Result<Client> {
    Ok(http_client_builder(url.starts_with("https:"))
        .map_err(anyhow::Error::msg)?
        .timeout(TIMEOUT)
        .build()?)
}

/// Returns the results of a run's newest layouts of a task, the newest first. Designers learn from them, and new layouts must
/// differ from them.
///
/// # Errors
/// Returns the errors of [`fetch_run`].
pub(super) async fn past_layouts(url: &str, run: &str, task: &str) -> anyhow::Result<Vec<PastLayout>> {
    let client = client(url)?;
    let base = url.trim_end_matches('/');
    let list = format!("{base}/v1/runs/{run}/designs?task={task}&limit={MAX_LISTED_DESIGNS}");
    let page: DesignPage = read(&get(&client, url, &list).await?, &list)?;
    let mut past = Vec::new();
    for head in
        page.designs.into_iter().filter(|head| head.state != DesignState::Refused).take(MAX_PAST_LAYOUTS)
    {
        let one = format!("{base}/v1/layouts/{}", head.id);
        let layout: Layout = read(&get(&client, url, &one).await?, &one)?;
        let Some(design) = layout.design else { continue };
        let sky = layout.scenario.get("seed").and_then(Value::as_u64).and_then(|seed| Seed::new(seed).ok());
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
        past.push(PastLayout { design, seed: sky, outcome: fate });
    }
    Ok(past)
}

/// Fetches the settings, levels, mastery and failures of a run.
///
/// # Errors
/// Returns an error if the service cannot be reached, has no such run, or sends an unexpected response. The message says how
/// to fix it.
pub(super) async fn fetch_run(url: &str, run: &str) -> anyhow::Result<RunSnapshot> {
    ensure!(
        !run.is_empty() && run.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.')),
        "--run: {run:?} is not a valid run id; GET /v1/runs lists the runs"
    );
    let client = client(url)?;
    let base = format!("{}/v1/runs/{run}", url.trim_end_matches('/'));
    let known: Run = read(&get(&client, url, &base).await?, &base)?;
    let settings: RunSettings =
        serde_json::from_value(known.summary.settings).with_context(|| format!("{base}: the settings"))?;
    let mastery: RunMastery = read(&get(&client, url, &format!("{base}/mastery")).await?, &base)?;
    let failures = get(&client, url, &format!("{base}/failure_profiles?examples=0")).await?;
    let mut tasks = Vec::new();
    for plan in settings.curriculum.tasks {
        let profile = FailureProfile::parse(&failures, Some(&plan.task))
            .with_context(|| format!("{base}/failure_profiles"))?;
        let mastery = mastery.tasks.iter().find(|mastery| mastery.task == plan.task);
        let level = mastery.and_then(|mastery| mastery.level.or(mastery.probe_level));
        let mastery = mastery.and_then(|mastery| mastery.mastery.as_ref()).filter(|known| known.n > 0);
        let mastery = mastery.map(|m| LevelMastery { n: m.n, mean: m.mean, q10: m.q10, q90: m.q90 });
        tasks.push(TaskSnapshot { plan, level, mastery, profile });
    }
    Ok(RunSnapshot { run: Some(run.to_owned()), tasks })
}

async fn get(client: &Client, service: &str, url: &str) -> anyhow::Result<String> {
    let answer = client.get(url).send().await.map_err(|error| {
        if error.is_connect() {
            anyhow!(
                "--url: there is no server at {service}; start one with `sparring serve`, or set --url to its address"
            )
        } else {
            anyhow!(error).context(format!("--url: {url}"))
        }
    })?;
    let status = answer.status();
    let text = answer.text().await.with_context(|| format!("--url: {url}"))?;
    if status.is_success() {
        return Ok(text);
    }
    let problem: ProblemDetails = serde_json::from_str(&text).unwrap_or_default();
    bail!("--run: {url}: {status}: {}", problem.message())
}

fn read<A: DeserializeOwned>(text: &str, url: &str) -> anyhow::Result<A> {
    serde_json::from_str(text).with_context(|| {
        format!("--url: the response of {url} is not that of a Sparring server of this version")
    })
}
