//! Activity of the trainers of a run.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Trainer that sent requests to a run within an hour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ActiveTrainer {
    /// Name that the trainer gives itself by the header `Sparring-Client`; null without one.
    #[schema(example = "gpu-3:4711")]
    pub name: Option<String>,
    /// Name of its token, or its address; null on a server that does not distinguish its clients.
    pub client: Option<String>,
    /// Time since its latest request, seconds.
    pub idle_s: f64,
    /// Number of requests a second.
    pub requests_per_s: f64,
    /// Number of requests that were refused or failed.
    pub errors: u64,
    /// Number of leases that it received.
    pub leases: u64,
    /// Reported episodes a second.
    pub episodes_per_s: f64,
    /// Mean time until it received a lease, seconds; null without leases.
    pub lease_wait_s: Option<f64>,
    /// Share of the time that it waited for leases, 0 to 1. The rest is left for training.
    pub waiting_share: f64,
    /// Newest version of its policy; null if it did not say.
    pub policy_version: Option<i64>,
    /// How many versions this is behind the newest one of the run; null without a version.
    pub staleness: Option<i64>,
}

/// Activity of the trainers of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrainerList {
    /// Time over which rates and counts are taken, seconds; less for a trainer that came later, and since the start of the server.
    pub window_s: f64,
    /// Trainers, the latest request first.
    pub trainers: Vec<ActiveTrainer>,
}
