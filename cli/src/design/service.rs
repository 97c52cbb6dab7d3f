//! What a running service knows of a run: its settings, its failures, where it stands.

use std::time::Duration;

use anyhow::{Context, anyhow, bail, ensure};
use api_types::{DesignPage, Layout, ProblemDetails, Run, RunMastery};
use designer::FailureProfile;
use designer::brief::{LayoutOutcome, LevelMastery, PastLayout};
use env_core::Seed;
use llm::http_client_builder;
use reqwest::Client;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::brief::{RunSnapshot, TaskSnapshot};
use curriculum::TaskPlan;

/// Longest time one request may take.
const TIMEOUT: Duration = Duration::from_secs(30);
/// Designs of a run that are listed; those that the gate refused are among them.
const HEADS: usize = 500;
/// Earlier layouts that a designer hears of.
const FATES: usize = 24;

/// Settings of a run, reduced to what a designer needs.
#[derive(Deserialize)]
struct DesignerSettings {
    curriculum: PlannedTasks,
}

#[derive(Deserialize)]
struct PlannedTasks {
    tasks: Vec<TaskPlan>,
}

fn client(url: &str) -> anyhow::Result<Client> {
    Ok(http_client_builder(url.starts_with("https:"))
        .map_err(anyhow::Error::msg)?
        .timeout(TIMEOUT)
        .build()?)
}

/// How a run's newest layouts of a task fared, the newest first: what is designed now learns from them and is not like them.
///
/// # Errors
/// As of [`ask`].
pub(super) async fn past(url: &str, run: &str, task: &str) -> anyhow::Result<Vec<PastLayout>> {
    let client = client(url)?;
    let base = url.trim_end_matches('/');
    let list = format!("{base}/v1/runs/{run}/designs?task={task}&limit={HEADS}");
    let page: DesignPage = read(&get(&client, url, &list).await?, &list)?;
    let mut past = Vec::new();
    for head in page.designs.into_iter().filter(|head| head.state != "refused").take(FATES) {
        let one = format!("{base}/v1/layouts/{}", head.id);
        let layout: Layout = read(&get(&client, url, &one).await?, &one)?;
        let Some(design) = layout.design else { continue };
        let sky = layout.scenario.get("seed").and_then(Value::as_u64).and_then(|seed| Seed::new(seed).ok());
        let fate = match (head.flown.success, head.flown.regret) {
            (Some(success), Some(regret)) => LayoutOutcome::Evaluated {
                episodes: u32::try_from(head.flown.episodes).unwrap_or(u32::MAX),
                success_rate: success,
                regret,
                aimed_share: head.flown.as_aimed,
                is_retired: head.state == "retired",
            },
            _ => LayoutOutcome::Untested,
        };
        past.push(PastLayout { design, seed: sky, outcome: fate });
    }
    Ok(past)
}

/// Asks for all of it.
///
/// # Errors
/// Nothing listens there, it knows no such run, or it answers something else; in a sentence that says what to do.
pub(super) async fn ask(url: &str, run: &str) -> anyhow::Result<RunSnapshot> {
    ensure!(
        !run.is_empty() && run.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.')),
        "--run: {run:?} is no run's id; GET /v1/runs lists them"
    );
    let client = client(url)?;
    let base = format!("{}/v1/runs/{run}", url.trim_end_matches('/'));
    let known: Run = read(&get(&client, url, &base).await?, &base)?;
    let settings: DesignerSettings =
        serde_json::from_value(known.summary.settings).with_context(|| format!("{base}: the settings"))?;
    let mastery: RunMastery = read(&get(&client, url, &format!("{base}/mastery")).await?, &base)?;
    let failures = get(&client, url, &format!("{base}/failures?examples=0")).await?;
    let mut tasks = Vec::new();
    for plan in settings.curriculum.tasks {
        let profile =
            FailureProfile::parse(&failures, Some(&plan.task)).with_context(|| format!("{base}/failures"))?;
        let mastery = mastery.tasks.iter().find(|mastery| mastery.task == plan.task);
        let level = mastery.and_then(|mastery| mastery.level.or(mastery.probing));
        let standing = mastery.and_then(|mastery| mastery.mastery.as_ref()).filter(|known| known.n > 0);
        let standing = standing.map(|m| LevelMastery { n: m.n, mean: m.mean, q10: m.q10, q90: m.q90 });
        tasks.push(TaskSnapshot { plan, level, mastery: standing, profile });
    }
    Ok(RunSnapshot { run: Some(run.to_owned()), tasks })
}

async fn get(client: &Client, service: &str, url: &str) -> anyhow::Result<String> {
    let answer = client.get(url).send().await.map_err(|error| {
        if error.is_connect() {
            anyhow!(
                "--url: nothing answers at {service}; start it with `sparring serve`, or say where it is with --url"
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
    serde_json::from_str(text)
        .with_context(|| format!("--url: what answers at {url} is no Sparring of this version"))
}
