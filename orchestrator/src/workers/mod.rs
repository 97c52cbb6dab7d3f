//! Background workers: one module for each job.
//!
//! A worker reads what is due, computes it, and stores the result by a change of the one writer. Every job is idempotent: repeated
//! work has no effect, so an aborted job is repeated after the next start. `service::background` spawns the workers.

pub mod checkpoint;
pub mod clock;
pub mod critique;
pub mod delete_runs;
pub mod design;
pub mod evaluate;
pub mod expire;
pub mod prepare;
pub mod retention;
pub mod revoke_connections;
pub mod rollout;
mod round_error;
