//! Actions of the curriculum in a crash test.

use std::fmt;

use anyhow::{Context, ensure};
use serde_json::Value;

use super::list_all;
use crate::ApiClient;

/// Numbers of the actions of the curriculum of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CurriculumProgress {
    /// Number of tasks whose placement ended.
    pub placements: u64,
    /// Number of moves to the next level.
    pub promotions: u64,
    /// Number of episodes that have a critique.
    pub critiques: u64,
    /// Number of designed layouts that the gate admitted.
    pub layouts: u64,
    /// Number of groups of designed layouts that were leased for training.
    pub designed_groups: u64,
}

impl CurriculumProgress {
    /// Asks the server for the numbers of a run.
    ///
    /// # Errors
    /// Returns an error if the server refuses a request, or if an answer lacks a number.
    pub(super) async fn fetch(api: &ApiClient, run: &str) -> anyhow::Result<Self> {
        let profiles = get(api, &format!("/v1/runs/{run}/failure_profiles")).await?;
        let designs = get(api, &format!("/v1/runs/{run}/designs/statistics")).await?;
        let moves = list_all(api, "level_moves", "moves").await?;
        let count = |kind: &str| moves.iter().filter(|level_move| level_move["kind"] == kind).count() as u64;
        Ok(Self {
            placements: count("placement"),
            promotions: count("up"),
            critiques: sum_of_tasks(&profiles, "criticised")?,
            layouts: sum_of_tasks(&designs, "admitted")?,
            designed_groups: designs["designed_groups"].as_u64().context("no number of designed groups")?,
        })
    }
}

async fn get(api: &ApiClient, path: &str) -> anyhow::Result<Value> {
    let response = api.get(path).await;
    ensure!(response.status == 200, "{path}: {}", response.body);
    Ok(response.body)
}

fn sum_of_tasks(body: &Value, field: &str) -> anyhow::Result<u64> {
    let tasks = body["tasks"].as_array().context("no tasks")?;
    tasks
        .iter()
        .map(|task| task[field].as_u64().with_context(|| format!("no number `{field}`: {task}")))
        .sum()
}

impl fmt::Display for CurriculumProgress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<52} {:>9}", "tasks whose placement ended", self.placements)?;
        writeln!(f, "{:<52} {:>9}", "moves to the next level", self.promotions)?;
        writeln!(f, "{:<52} {:>9}", "episodes with a critique", self.critiques)?;
        writeln!(f, "{:<52} {:>9}", "designed layouts that the gate admitted", self.layouts)?;
        write!(f, "{:<52} {:>9}", "groups of designed layouts", self.designed_groups)
    }
}
