//! Frozen suites of evaluations.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Suites that the server has.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct SuiteList {
    /// Name of the default suite.
    pub default: String,
    /// Suites, the newest of each world first.
    pub suites: Vec<Suite>,
}

/// Frozen suite of scenarios.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Suite {
    /// Name of the suite.
    pub name: String,
    /// Hash of the suite: evaluations with the same hash are comparable.
    pub hash: String,
    /// Number of scenarios in the suite.
    pub scenarios: usize,
    /// Ids of their tasks.
    pub tasks: Vec<String>,
    /// Built-in policies of every task of the suite, which the server can evaluate.
    pub policies: Vec<String>,
}
