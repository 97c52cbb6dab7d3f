//! The Sparring service: an adaptive curriculum for agents that operate satellites, behind an HTTP API.
//!
//! [`service::Service`] starts everything. From the outside to the inside:
//!
//! - [`http`] parses requests, [`queries`] are its read models.
//! - Use cases: [`runs`], [`leases`], [`results`], [`critiques`], [`designs`], [`rollouts`], [`evaluations`], [`retention`],
//!   [`alerts`].
//! - [`engine`] is the only writer of the database and holds the state of runs; the crate `store` has all SQL.
//! - [`workers`] run in the background.
//! - [`ownership`] decides which client may use a lease or a run, [`limits`] bound what clients may use.
//! - [`sessions`] run environments on the server.
//! - [`shards`] are the servers among which a team divides its runs.
//!
//! The curriculum's decisions are in the crate `curriculum`, the worlds in `env-core`, suites and
//! statistics in `evaluation`, chat policy and judges in `llm-policy`, and the command line in `cli`.

pub mod alerts;
mod api_enums;
pub mod critiques;
pub mod designs;
pub mod disk_space;
pub mod engine;
pub mod evaluations;
pub mod http;
pub mod leases;
pub mod limits;
pub mod metrics;
pub mod ownership;
pub mod queries;
pub mod results;
pub mod retention;
pub mod rollouts;
pub mod runs;
pub mod service;
pub mod sessions;
pub mod shards;
pub mod threads;
pub mod tokens;
pub mod trainer_activity;
pub mod workers;
