//! Client of the service over HTTP, like that of any trainer.

use anyhow::Context;
use api_types::{
    DesignPage, DesignStatistics, Lease, LeaseRequest, ResultsRequest, ResultsResponse, RunMastery,
    RunRequest, RunSummary, TaskMastery,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::designs::Designs;
use super::feed::{Feed, FinishedEpisode};
use crate::api::{ApiClient, CaArgs};

/// Lifetime of a lease in seconds: many times the duration of a batch.
const TTL_S: u32 = 120;
/// Largest number of designs that are read: far more than a demo gets.
const MAX_DESIGNS: usize = 20_000;

/// Run on a service, with the client that reaches it.
#[derive(Debug)]
pub(super) struct HttpFeed {
    api: ApiClient,
    run: String,
}

impl HttpFeed {
    /// Creates a run on the service at this URL.
    pub(super) async fn create(service: &str, request: &RunRequest) -> anyhow::Result<Self> {
        let api = ApiClient::new(service, &CaArgs::default())?;
        let created: RunSummary = api.post("/v1/runs", request).await.context("no run was created")?;
        Ok(Self { api, run: created.id })
    }

    /// Returns the id of the run.
    pub(super) fn run(&self) -> &str {
        &self.run
    }

    /// Pauses the run, so that it grants no more leases and no alert reports it as stalled.
    pub(super) async fn pause(&self) -> anyhow::Result<()> {
        let _: RunSummary = self.api.post_empty(&format!("/v1/runs/{}/pause", self.run)).await?;
        Ok(())
    }

    async fn get<A: DeserializeOwned>(&self, path: &str) -> anyhow::Result<A> {
        self.api.get(&format!("/v1/runs/{}/{path}", self.run)).await
    }

    async fn post<A: DeserializeOwned>(&self, path: &str, body: &impl Serialize) -> anyhow::Result<A> {
        self.api.post(&format!("/v1/runs/{}/{path}", self.run), body).await
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
