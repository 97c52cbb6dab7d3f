//! Runs by id, unique prefix of an id, or name.

use anyhow::bail;
use api_types::{RunPage, RunSummary};

use super::{ApiClient, with_query};
use crate::names::suggest;

/// Number of runs in one request.
const PAGE: &str = "500";

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

/// Finds a run by its id, by a prefix of one id only, or by a name of one run only. Without `wanted`, returns the only run.
///
/// # Errors
/// Returns an error that lists the candidates or similar names if no single run is meant.
pub async fn find_run(api: &ApiClient, wanted: Option<&str>) -> anyhow::Result<RunSummary> {
    let mut runs = list_runs(api, false, None).await?;
    if wanted.is_none() {
        return only_run(runs);
    }
    runs.append(&mut list_runs(api, true, None).await?);
    select_run(runs, wanted.unwrap_or_default())
}

fn only_run(mut runs: Vec<RunSummary>) -> anyhow::Result<RunSummary> {
    match runs.len() {
        1 => Ok(runs.remove(0)),
        0 => bail!("there are no runs; `sparring runs create` creates one"),
        _ => bail!("name a run: {}", describe(runs.iter())),
    }
}

fn select_run(mut runs: Vec<RunSummary>, wanted: &str) -> anyhow::Result<RunSummary> {
    if let Some(at) = runs.iter().position(|run| run.id == wanted) {
        return Ok(runs.remove(at));
    }
    let is_meant =
        |run: &&RunSummary| !wanted.is_empty() && (run.id.starts_with(wanted) || run.name == wanted);
    let meant: Vec<&RunSummary> = runs.iter().filter(is_meant).collect();
    match meant.as_slice() {
        [one] => Ok((*one).clone()),
        [] => {
            let known = runs.iter().flat_map(|run| [run.id.as_str(), run.name.as_str()]);
            bail!("there is no run {wanted:?}{}; `sparring runs list` lists all", suggest(wanted, known))
        }
        several => bail!("several runs match {wanted:?}: {}", describe(several.iter().copied())),
    }
}

/// Lists runs as `id (name)`, the newest first.
fn describe<'a>(runs: impl DoubleEndedIterator<Item = &'a RunSummary>) -> String {
    /// Largest number of listed runs.
    const MAX_LISTED: usize = 10;
    let mut words: Vec<String> = runs.rev().map(|run| format!("{} ({})", run.id, run.name)).collect();
    let more = words.len().saturating_sub(MAX_LISTED);
    words.truncate(MAX_LISTED);
    if more > 0 {
        words.push(format!("{more} more"));
    }
    words.join(", ")
}

#[cfg(test)]
mod tests {
    use api_types::RunStatus;
    use serde_json::Value;

    use super::*;

    fn run(id: &str, name: &str) -> RunSummary {
        RunSummary {
            id: id.to_owned(),
            name: name.to_owned(),
            seed: 0,
            status: RunStatus::Active,
            created_at: String::new(),
            archived_at: None,
            policy_version: 0,
            tags: Vec::new(),
            settings: Value::Null,
        }
    }

    #[test]
    fn runs_are_found_by_id_prefix_and_name() {
        let runs = || vec![run("run-1a", "first"), run("run-1b", "second"), run("run-1", "second")];
        let found =
            |wanted: &str| select_run(runs(), wanted).map(|run| run.id).map_err(|error| error.to_string());
        assert_eq!(found("run-1").as_deref(), Ok("run-1"));
        assert_eq!(found("run-1a").as_deref(), Ok("run-1a"));
        assert_eq!(found("first").as_deref(), Ok("run-1a"));
        let faults = ["second", "run-", "frist", ""].map(|wanted| found(wanted).unwrap_err());
        insta::assert_snapshot!(faults.join("\n"));
        assert_eq!(only_run(vec![run("a", "b")]).unwrap().id, "a");
        assert!(only_run(Vec::new()).unwrap_err().to_string().contains("runs create"));
        assert_eq!(
            only_run(vec![run("a", "x"), run("b", "y")]).unwrap_err().to_string(),
            "name a run: b (y), a (x)"
        );
    }
}
