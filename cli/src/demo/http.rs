//! The service over HTTP, as any trainer meets it.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use api_types::{LeaseRequest, ProblemDetails, RunSummary};
use reqwest::header::RETRY_AFTER;
use reqwest::{Client, Method, StatusCode};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::designs::{Design, Designs};
use super::feed::{Feed, Finished, Lease, Receipts, TaskMastery};

/// How long a lease holds: many times what a batch takes.
const TTL_S: u32 = 120;
/// How long a busy service is asked again before the demo gives up.
const PATIENCE: Duration = Duration::from_secs(120);
/// Longest pause between two tries, whatever Retry-After says.
const MAX_PAUSE: Duration = Duration::from_secs(10);
/// Designs that are looked through: far more than a demo gets.
const MAX_DESIGNS: usize = 20_000;
/// Longest time one request may take.
const TIMEOUT: Duration = Duration::from_secs(60);

/// A run on a service.
#[derive(Debug)]
pub(super) struct HttpFeed {
    client: Client,
    /// `http://…/v1/runs/{run}`.
    url: String,
    run: String,
}

/// The run a trainer asks for.
#[derive(Debug, Serialize)]
pub(super) struct RunWish<'a> {
    pub(super) name: &'a str,
    pub(super) seed: u64,
    pub(super) strategy: &'a str,
    pub(super) target: &'a str,
    pub(super) placement: bool,
    pub(super) group_size: usize,
    pub(super) tasks: &'a [String],
    pub(super) design: DesignWish,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) task_settings: BTreeMap<&'static str, TaskWish<'a>>,
}

/// What it wants of designs.
#[derive(Debug, Serialize)]
pub(super) struct DesignWish {
    pub(super) designer: &'static str,
}

/// What is special about one of its tasks.
#[derive(Debug, Serialize)]
pub(super) struct TaskWish<'a> {
    pub(super) physics: &'a BTreeMap<String, String>,
}

impl HttpFeed {
    /// Creates a run on the service at this URL.
    pub(super) async fn create(service: &str, wish: &RunWish<'_>) -> anyhow::Result<Self> {
        let plain = llm::http_client_builder(false).map_err(anyhow::Error::msg)?;
        let client = plain.timeout(TIMEOUT).build()?;
        let runs = format!("{}/v1/runs", service.trim_end_matches('/'));
        let created: RunSummary =
            send(&client, Method::POST, &runs, Some(wish)).await.context("no run was created")?;
        Ok(Self { client, url: format!("{runs}/{}", created.id), run: created.id })
    }

    /// Returns the id of the run.
    pub(super) fn run(&self) -> &str {
        &self.run
    }

    async fn get<A: DeserializeOwned>(&self, path: &str) -> anyhow::Result<A> {
        send(&self.client, Method::GET, &format!("{}/{path}", self.url), None::<&()>).await
    }

    async fn post<A: DeserializeOwned>(&self, path: &str, body: &impl Serialize) -> anyhow::Result<A> {
        send(&self.client, Method::POST, &format!("{}/{path}", self.url), Some(body)).await
    }
}

impl Feed for HttpFeed {
    async fn lease(&self, groups: usize, policy_version: u32) -> anyhow::Result<Lease> {
        let wish = LeaseRequest {
            policy_version,
            ttl_s: TTL_S,
            ..LeaseRequest::new(u32::try_from(groups).unwrap_or(u32::MAX))
        };
        self.post("leases", &wish).await
    }

    async fn report(&self, policy_version: u32, results: Vec<Finished>) -> anyhow::Result<Receipts> {
        #[derive(Serialize)]
        struct Results {
            policy_version: u32,
            results: Vec<Finished>,
        }
        self.post("results", &Results { policy_version, results }).await
    }

    async fn mastery(&self) -> anyhow::Result<Vec<TaskMastery>> {
        #[derive(Deserialize)]
        struct Masteries {
            tasks: Vec<TaskMastery>,
        }
        let masteries: Masteries = self.get("mastery").await?;
        Ok(masteries.tasks)
    }

    async fn designs(&self) -> anyhow::Result<Designs> {
        #[derive(Deserialize)]
        struct Summary {
            share: Option<f64>,
        }
        #[derive(Deserialize)]
        struct Page {
            designs: Vec<Design>,
            next: Option<String>,
        }
        let Summary { share } = self.get("designs/summary").await?;
        let mut designs = Designs { share, all: Vec::new() };
        let mut page: Page = self.get("designs?limit=500").await?;
        loop {
            designs.all.append(&mut page.designs);
            let Some(next) = page.next.filter(|_| designs.all.len() < MAX_DESIGNS) else {
                return Ok(designs);
            };
            page = self.get(&format!("designs?limit=500&cursor={next}")).await?;
        }
    }
}

/// Sends a request; where the service says it is busy, waits as long as it asks for and sends it again. Everything the
/// demo sends may be sent twice: results are idempotent, a lease too many expires.
async fn send<A: DeserializeOwned>(
    client: &Client,
    method: Method,
    url: &str,
    body: Option<&impl Serialize>,
) -> anyhow::Result<A> {
    let until = Instant::now() + PATIENCE;
    loop {
        let mut request = client.request(method.clone(), url);
        if let Some(body) = body {
            request = request.json(body);
        }
        let answer = request.send().await.with_context(|| format!("{method} {url}"))?;
        let status = answer.status();
        if status.is_success() {
            let bytes = answer.bytes().await.with_context(|| format!("{method} {url}"))?;
            return serde_json::from_slice(&bytes).with_context(|| format!("{method} {url}: the answer"));
        }
        let busy = matches!(status, StatusCode::TOO_MANY_REQUESTS | StatusCode::SERVICE_UNAVAILABLE);
        if busy && Instant::now() < until {
            tokio::time::sleep(pause(answer.headers().get(RETRY_AFTER).and_then(|v| v.to_str().ok()))).await;
            continue;
        }
        let problem: ProblemDetails =
            answer.bytes().await.ok().and_then(|b| serde_json::from_slice(&b).ok()).unwrap_or_default();
        bail!("{method} {url}: {status}: {}", problem.message_with_field());
    }
}

/// How long to wait, by Retry-After in seconds; a second where it says nothing that is understood.
fn pause(retry_after: Option<&str>) -> Duration {
    let seconds = retry_after.and_then(|text| text.trim().parse().ok()).unwrap_or(1);
    Duration::from_secs(seconds).clamp(Duration::from_millis(100), MAX_PAUSE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_are_bounded() {
        assert_eq!(pause(Some("2")), Duration::from_secs(2));
        assert_eq!(pause(Some("0")), Duration::from_millis(100));
        assert_eq!(pause(Some("3600")), MAX_PAUSE);
        assert_eq!(pause(Some("Wed, 21 Oct 2026 07:28:00 GMT")), Duration::from_secs(1));
        assert_eq!(pause(None), Duration::from_secs(1));
    }
}
