//! What a running service knows of a run: its settings, its failures, where it stands.

use std::time::Duration;

use anyhow::{Context, anyhow, bail, ensure};
use designer::Profile;
use designer::brief::Standing;
use designer::llm::http_client;
use reqwest::Client;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::brief::{OfRun, Told};
use crate::curriculum::TaskPlan;

/// Longest time one request may take.
const TIMEOUT: Duration = Duration::from_secs(30);

/// GET /v1/runs/{run}, what of it is needed.
#[derive(Deserialize)]
struct Run {
    settings: RunSettings,
}

#[derive(Deserialize)]
struct RunSettings {
    curriculum: Curriculum,
}

#[derive(Deserialize)]
struct Curriculum {
    tasks: Vec<TaskPlan>,
}

/// GET /v1/runs/{run}/mastery, what of it is needed.
#[derive(Deserialize)]
struct Masteries {
    tasks: Vec<TaskMastery>,
}

#[derive(Deserialize)]
struct TaskMastery {
    task: String,
    level: Option<u32>,
    probing: Option<u32>,
    mastery: Option<Posterior>,
}

#[derive(Deserialize)]
struct Posterior {
    n: u32,
    mean: f64,
    q10: f64,
    q90: f64,
}

/// RFC 9457, what of it people need.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Problem {
    title: Option<String>,
    detail: Option<String>,
}

/// Asks for all of it.
///
/// # Errors
/// Nothing listens there, it knows no such run, or it answers something else; in a sentence that says what to do.
pub(super) async fn ask(url: &str, run: &str) -> anyhow::Result<Told> {
    ensure!(
        !run.is_empty() && run.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.')),
        "--run: {run:?} is no run's id; GET /v1/runs lists them"
    );
    let client =
        http_client(url.starts_with("https:")).map_err(anyhow::Error::msg)?.timeout(TIMEOUT).build()?;
    let base = format!("{}/v1/runs/{run}", url.trim_end_matches('/'));
    let known: Run = read(&get(&client, url, &base).await?, &base)?;
    let masteries: Masteries = read(&get(&client, url, &format!("{base}/mastery")).await?, &base)?;
    let failures = get(&client, url, &format!("{base}/failures?examples=0")).await?;
    let mut tasks = Vec::new();
    for plan in known.settings.curriculum.tasks {
        let profile =
            Profile::read(&failures, Some(&plan.task)).with_context(|| format!("{base}/failures"))?;
        let mastery = masteries.tasks.iter().find(|mastery| mastery.task == plan.task);
        let level = mastery.and_then(|mastery| mastery.level.or(mastery.probing));
        let standing = mastery.and_then(|mastery| mastery.mastery.as_ref()).filter(|known| known.n > 0);
        let standing = standing.map(|m| Standing { n: m.n, mean: m.mean, q10: m.q10, q90: m.q90 });
        tasks.push(OfRun { plan, level, standing, profile });
    }
    Ok(Told { run: Some(run.to_owned()), tasks })
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
    let Problem { title, detail } = serde_json::from_str(&text).unwrap_or_default();
    let said = detail.or(title).unwrap_or_else(|| "the service does not say why".to_owned());
    bail!("--run: {url}: {status}: {said}")
}

fn read<A: DeserializeOwned>(text: &str, url: &str) -> anyhow::Result<A> {
    serde_json::from_str(text)
        .with_context(|| format!("--url: what answers at {url} is no Sparring of this version"))
}
