//! Background workers: one module for each job.
//!
//! A worker reads what is due, computes it, and stores the result by a change of the one writer. Every job is idempotent: repeated
//! work has no effect, so an aborted job is repeated after the next start. [`WorkerConfig::spawn`] starts the workers.

mod alert;
pub mod checkpoint;
mod clock;
mod critique;
mod delete_archived;
pub mod delete_runs;
mod design;
mod evaluate;
mod expire;
mod feed_stream;
mod prepare;
mod remote_workers;
mod retention;
mod revoke_connections;
mod rollout;
mod round_error;
mod spawn;

pub use self::feed_stream::FeedServer;
pub use self::prepare::MAX_JOBS as MAX_PREPARE_JOBS;
pub use self::spawn::{RemoteQueue, WorkerConfig};
