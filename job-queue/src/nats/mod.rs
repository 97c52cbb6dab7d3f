//! Jobs on NATS JetStream: a server that publishes them, and workers that do them.
//!
//! Two work-queue streams carry jobs and results; [`names`] has their subjects, [`streams`] their settings. Core NATS carries the
//! heartbeats of workers and the answers of servers ([`membership`]). JetStream has no fencing: a worker whose time is over can still
//! acknowledge. Every job therefore has a token, and the server takes a result only if the token is that of its pending job.

mod connection;
pub(crate) mod membership;
mod names;
pub mod server;
mod streams;
#[cfg(test)]
mod tests;
pub mod worker;

pub use self::connection::{NatsConfig, NatsError};
pub use self::names::{ClusterName, InvalidClusterName};
