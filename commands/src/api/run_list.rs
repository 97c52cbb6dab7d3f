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

/// Lists all runs, or those with a tag, oldest first: the archived ones, or the others.
///
/// # Errors
/// Returns the errors of [`ApiClient::get`].
pub async fn list_runs(
    api: &ApiClient,
    archived: bool,
    tag: Option<&str>,
) -> anyhow::Result<Vec<RunSummary>> {
    let mut query = vec![("limit", PAGE), ("archived", if archived { "true" } else { "false" })];
    query.extend(tag.map(|tag| ("tag", tag)));
    let first = with_query("/v1/runs", &query);
    let mut page: RunPage = api.get(&first).await?;
    let mut runs = page.runs;
    while let Some(cursor) = page.next {
        page = api.get(&format!("{first}&cursor={cursor}")).await?;
        runs.append(&mut page.runs);
    }
    Ok(runs)
}

/// Finds a run by its id, by a prefix of one id only, or by a name of one run only. Without `wanted`, returns the only run
/// that is not archived.
///
/// # Errors
/// Returns an error that lists the candidates or similar names if no single run is meant.
pub async fn find_run(api: &ApiClient, wanted: Option<&str>) -> anyhow::Result<RunSummary> {
    let mut runs = list_runs(api, false, None).await?;
    if wanted.is_some() {
        runs.append(&mut list_runs(api, true, None).await?);
    }
    select_run(runs, wanted)
}
