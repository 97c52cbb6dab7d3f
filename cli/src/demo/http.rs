//! Client of the service over HTTP, like that of any trainer.

use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use api_types::{
    DesignPage, DesignStatistics, Lease, LeaseRequest, ProblemDetails, ResultsRequest, ResultsResponse,
    RunMastery, RunRequest, RunSummary, TaskMastery,
};
use reqwest::header::RETRY_AFTER;
use reqwest::{Client, Method, StatusCode};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::designs::Designs;
use super::feed::{Feed, FinishedEpisode};

/// Lifetime of a lease in seconds: many times the duration of a batch.
const TTL_S: u32 = 120;
/// How long requests to a busy service are retried.
const RETRY_TIMEOUT: Duration = Duration::from_secs(120);
/// Longest pause between two attempts; caps Retry-After.
const MAX_PAUSE: Duration = Duration::from_secs(10);
/// Largest number of designs that are read: far more than a demo gets.
const MAX_DESIGNS: usize = 20_000;
/// Timeout of one request.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Run on a service, with the client that reaches it.
#[derive(Debug)]
pub(super) struct HttpFeed {
    client: Client,
    /// URL of the run: `http://…/v1/runs/{run}`.
    url: String,
    run: String,
}

impl HttpFeed {
    /// Creates a run on the service at this URL.
    pub(super) async fn create(service: &str, request: &RunRequest) -> anyhow::Result<Self> {
        let plain = llm::http_client_builder(false).map_err(anyhow::Error::msg)?;
        let client = plain.timeout(TIMEOUT).build()?;
        let runs = format!("{}/v1/runs", service.trim_end_matches('/'));
        let created: RunSummary =
            send(&client, Method::POST, &runs, Some(request)).await.context("no run was created")?;
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
        let request = LeaseRequest {
            policy_version,
            ttl_s: TTL_S,
            ..LeaseRequest::new(u32::try_from(groups).unwrap_or(u32::MAX))
        };
        self.post("leases", &request).await
    }

    async fn report(
        &self,
        policy_version: u32,
        episodes: Vec<FinishedEpisode>,
    ) -> anyhow::Result<ResultsResponse> {
        let results = episodes.into_iter().map(|episode| serde_json::to_value(episode.into_result()));
        let results = results.collect::<Result<_, _>>()?;
        self.post("results", &ResultsRequest { policy_version: Some(policy_version), results }).await
    }

    async fn mastery(&self) -> anyhow::Result<Vec<TaskMastery>> {
        let mastery: RunMastery = self.get("mastery").await?;
        Ok(mastery.tasks)
    }

    async fn designs(&self) -> anyhow::Result<Designs> {
        let DesignStatistics { share, .. } = self.get("designs/statistics").await?;
        let mut designs = Designs { share, all: Vec::new() };
        let mut page: DesignPage = self.get("designs?limit=500").await?;
        loop {
            designs.all.append(&mut page.designs);
            let Some(next) = page.next.filter(|_| designs.all.len() < MAX_DESIGNS) else {
                return Ok(designs);
            };
            page = self.get(&format!("designs?limit=500&cursor={next}")).await?;
        }
    }
}

/// Sends a request. If the service is busy, waits as long as Retry-After says and retries. Every request of the demo may be
/// repeated: reports are idempotent, and an unused lease expires.
///
/// # Errors
/// Returns an error if the service cannot be reached, rejects the request, or stays busy for [`RETRY_TIMEOUT`].
async fn send<A: DeserializeOwned>(
    client: &Client,
    method: Method,
    url: &str,
    body: Option<&impl Serialize>,
) -> anyhow::Result<A> {
    let until = Instant::now() + RETRY_TIMEOUT;
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

/// Returns the pause before the next attempt: Retry-After in seconds, or one second if the header is missing or invalid.
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
