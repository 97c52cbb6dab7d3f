//! Runs of a server.

use api_types::{RunPage, RunSummary};

use super::{ApiClient, with_query};
use crate::run_names::{NamedRun, select_run};

/// Number of runs in one request.
const PAGE: &str = "500";

impl NamedRun for RunSummary {
    fn id(&self) -> &str {
        &self.id
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn is_archived(&self) -> bool {
        self.archived_at.is_some()
    }
}

/// Lists all runs that match the parameters of `GET /v1/runs`, oldest first unless they have another order.
///
/// # Errors
/// Returns the errors of [`ApiClient::get`].
pub async fn list_runs(api: &ApiClient, parameters: &[(&str, &str)]) -> anyhow::Result<Vec<RunSummary>> {
    let (mut runs, mut cursor) = (Vec::new(), None::<String>);
    loop {
        let mut query = vec![("limit", PAGE)];
        query.extend(parameters);
        query.extend(cursor.as_deref().map(|cursor| ("cursor", cursor)));
        let mut page: RunPage = api.get(&with_query("/v1/runs", &query)).await?;
        runs.append(&mut page.runs);
        for missing in page.missing_shards.iter().filter(|_| cursor.is_none()) {
            tracing::warn!("The runs of the shard {} are missing: {}.", missing.shard, missing.reason);
        }
        match page.next {
            Some(next) => cursor = Some(next),
            None => return Ok(runs),
        }
    }
}

/// Finds a run by its id, by a prefix of one id only, or by a name of one run only. Without `wanted`, returns the only run
/// that is not archived.
///
/// # Errors
/// Returns an error that lists the candidates or similar names if no single run is meant.
pub async fn find_run(api: &ApiClient, wanted: Option<&str>) -> anyhow::Result<RunSummary> {
    let mut runs = list_runs(api, &[]).await?;
    if wanted.is_some() {
        runs.append(&mut list_runs(api, &[("archived", "true")]).await?);
    }
    select_run(runs, wanted)
}
