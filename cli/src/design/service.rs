//! What a running service knows of a run: its settings, its failures, where it stands.

use std::time::Duration;

use anyhow::{Context, anyhow, bail, ensure};
use designer::FailureProfile;
use designer::brief::{LayoutOutcome, PastLayout, LevelMastery};
use llm::http_client_builder;
use env_core::Seed;
use reqwest::Client;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::brief::{OfRun, Told};
use curriculum::TaskPlan;

/// Longest time one request may take.
const TIMEOUT: Duration = Duration::from_secs(30);
/// Designs of a run that are listed; those that the gate refused are among them.
const HEADS: usize = 500;
/// Earlier layouts that a designer hears of.
const FATES: usize = 24;

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

/// GET /v1/runs/{run}/designs, what of it is needed.
#[derive(Deserialize)]
struct Designs {
    designs: Vec<Head>,
}

#[derive(Deserialize)]
struct Head {
    id: String,
    state: String,
    flown: Flown,
}

#[derive(Deserialize)]
struct Flown {
    episodes: u32,
    success: Option<f64>,
    regret: Option<f64>,
    as_aimed: Option<f64>,
}

/// GET /v1/layouts/{layout}, what of it is needed.
#[derive(Deserialize)]
struct Layout {
    design: Option<Value>,
    scenario: Value,
}

/// RFC 9457, what of it people need.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Problem {
    title: Option<String>,
    detail: Option<String>,
}

fn client(url: &str) -> anyhow::Result<Client> {
    Ok(http_client_builder(url.starts_with("https:")).map_err(anyhow::Error::msg)?.timeout(TIMEOUT).build()?)
}

/// How a run's newest layouts of a task fared, the newest first: what is designed now learns from them and is not like them.
///
/// # Errors
/// As of [`ask`].
pub(super) async fn past(url: &str, run: &str, task: &str) -> anyhow::Result<Vec<PastLayout>> {
    let client = client(url)?;
    let base = url.trim_end_matches('/');
    let list = format!("{base}/v1/runs/{run}/designs?task={task}&limit={HEADS}");
    let heads: Designs = read(&get(&client, url, &list).await?, &list)?;
    let mut past = Vec::new();
    for head in heads.designs.into_iter().filter(|head| head.state != "refused").take(FATES) {
        let one = format!("{base}/v1/layouts/{}", head.id);
        let layout: Layout = read(&get(&client, url, &one).await?, &one)?;
        let Some(design) = layout.design else { continue };
        let sky = layout.scenario.get("seed").and_then(Value::as_u64).and_then(|seed| Seed::new(seed).ok());
        let fate = match (head.flown.success, head.flown.regret) {
            (Some(success), Some(regret)) => LayoutOutcome::Evaluated {
                episodes: head.flown.episodes,
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
pub(super) async fn ask(url: &str, run: &str) -> anyhow::Result<Told> {
    ensure!(
        !run.is_empty() && run.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.')),
        "--run: {run:?} is no run's id; GET /v1/runs lists them"
    );
    let client = client(url)?;
    let base = format!("{}/v1/runs/{run}", url.trim_end_matches('/'));
    let known: Run = read(&get(&client, url, &base).await?, &base)?;
    let masteries: Masteries = read(&get(&client, url, &format!("{base}/mastery")).await?, &base)?;
    let failures = get(&client, url, &format!("{base}/failures?examples=0")).await?;
    let mut tasks = Vec::new();
    for plan in known.settings.curriculum.tasks {
        let profile =
            FailureProfile::parse(&failures, Some(&plan.task)).with_context(|| format!("{base}/failures"))?;
        let mastery = masteries.tasks.iter().find(|mastery| mastery.task == plan.task);
        let level = mastery.and_then(|mastery| mastery.level.or(mastery.probing));
        let standing = mastery.and_then(|mastery| mastery.mastery.as_ref()).filter(|known| known.n > 0);
        let standing = standing.map(|m| LevelMastery { n: m.n, mean: m.mean, q10: m.q10, q90: m.q90 });
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
