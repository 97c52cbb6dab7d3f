//! Jobs on NATS JetStream: a server that publishes them, and workers that do them. Trajectory feeds use the same connection settings.
//!
//! Two work-queue streams carry jobs and results; [`names`] has their subjects, [`streams`] their settings. Core NATS carries the
//! heartbeats of workers and the answers of servers ([`membership`]). JetStream has no fencing: a worker whose time is over can still
//! acknowledge. Every job therefore has a token, and the server takes a result only if the token is that of its pending job.
//!
//! [`feed`] publishes the trajectory feeds of runs, and their states.

mod connection;
pub mod feed;
pub(crate) mod membership;
mod names;
mod objects;
pub mod server;
mod streams;
#[cfg(test)]
mod tests;
mod url;
pub mod worker;

pub use self::connection::{NatsConfig, NatsError};
pub use self::names::{ClusterName, InvalidClusterName};
pub use self::url::{InvalidNatsUrl, NatsUrl};
