//! The frozen suites that evaluations are flown on.

use serde::Serialize;
use utoipa::ToSchema;

use super::super::extract::NoQuery;
use super::super::problem::Problem;
use super::super::room::aside;
use crate::evaluation::suite::file::{BUILT_IN_SUITES, DEFAULT_SUITE, built_in};

/// All suites.
#[derive(Serialize, ToSchema)]
pub(super) struct Suites {
    /// The one that is meant where nobody says which.
    usual: &'static str,
    /// The newest of each world first.
    suites: Vec<SuiteView>,
}

/// A suite.
#[derive(Serialize, ToSchema)]
struct SuiteView {
    /// Its name.
    name: &'static str,
    /// Its hash: evaluations of the same compare.
    hash: &'static str,
    /// Its scenarios.
    scenarios: usize,
    /// Their tasks.
    tasks: Vec<&'static str>,
    /// The built-in policies that every one of its tasks has: the server flies them.
    policies: Vec<&'static str>,
}

/// List the suites that evaluations are flown on.
#[utoipa::path(
    get, path = "/suites", tag = "evaluations", operation_id = "list_suites",
    responses((status = 200, body = Suites), (status = 400, body = Problem))
)]
pub(super) async fn list(_: NoQuery) -> Result<axum::Json<Suites>, Problem> {
    // Read once, on first use: a moment's work that must not stand in others' way.
    let suites = aside(|| Ok(BUILT_IN_SUITES.iter().filter_map(|suite| view(suite.name)).collect())).await?;
    Ok(axum::Json(Suites { usual: DEFAULT_SUITE, suites }))
}

fn view(name: &'static str) -> Option<SuiteView> {
    let of = built_in(name)?;
    let tasks = of.suite.tasks();
    let has =
        |policy: &str| tasks.iter().all(|task| task.policies().iter().any(|known| known.name == policy));
    let first = tasks.first()?.policies().iter().map(|policy| policy.name);
    Some(SuiteView {
        name,
        hash: &of.hash,
        scenarios: of.suite.entries().count(),
        tasks: tasks.iter().map(|task| task.id()).collect(),
        policies: first.filter(|policy| has(policy)).collect(),
    })
}
