//! Frozen suites of evaluations.

use api_types::{Suite, SuiteList};

use crate::http::blocking::run_blocking;
use crate::http::extract::NoQuery;
use crate::http::problem::Problem;
use evaluation::suite::file::{BUILT_IN_SUITES, DEFAULT_SUITE, built_in};

/// List the frozen suites of evaluations.
#[utoipa::path(
    get, path = "/suites", tag = "evaluations",
    responses((status = 200, body = SuiteList), (status = 400, body = Problem))
)]
pub(super) async fn list_suites(_: NoQuery) -> Result<axum::Json<SuiteList>, Problem> {
    // A suite is read on first use, which takes too long for a thread of the runtime.
    let suites =
        run_blocking(|| Ok(BUILT_IN_SUITES.iter().filter_map(|suite| suite_response(suite.name)).collect()))
            .await?;
    Ok(axum::Json(SuiteList { default: DEFAULT_SUITE.to_owned(), suites }))
}

fn suite_response(name: &str) -> Option<Suite> {
    let loaded = built_in(name)?;
    let tasks = loaded.suite.tasks();
    let is_common =
        |policy: &str| tasks.iter().all(|task| task.policies().iter().any(|known| known.name == policy));
    let first = tasks.first()?.policies().iter().map(|policy| policy.name);
    Some(Suite {
        name: name.to_owned(),
        hash: loaded.hash.clone(),
        scenarios: loaded.suite.entries().count(),
        tasks: tasks.iter().map(|task| task.id().to_owned()).collect(),
        policies: first.filter(|policy| is_common(policy)).map(str::to_owned).collect(),
    })
}
