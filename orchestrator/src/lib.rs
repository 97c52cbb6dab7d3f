//! The Sparring service: an adaptive curriculum for agents that operate satellites, behind an HTTP API.
//!
//! [`service::Service`] starts everything. From the outside to the inside:
//!
//! - [`http`] parses requests, [`queries`] are its read models, [`input`] reads JSON strictly.
//! - Use cases: [`runs`], [`leases`], [`results`], [`critiques`], [`designs`], [`rollouts`], [`evaluation`], [`retention`].
//! - [`engine`] is the only writer of the database and holds the state of runs; the crate `store` has all SQL.
//! - [`workers`] run in the background.
//! - [`limits`] bound what clients may use.
//! - [`sessions`] run environments on the server; [`judging`] judges their steps, [`policy`] lets a language model act.
//!
//! The curriculum's decisions are in the crate `curriculum`, the worlds in `env-core`, the command line in `cli`.

mod api_enums;
pub mod clock;
pub mod critiques;
pub mod designs;
pub mod engine;
pub mod evaluation;
pub mod frames;
pub mod http;
pub mod input;
pub mod judging;
pub mod leases;
pub mod limits;
pub mod metrics;
pub mod policy;
pub mod queries;
pub mod results;
pub mod retention;
pub mod rollouts;
pub mod runs;
pub mod service;
pub mod sessions;
pub mod threads;
pub mod tokens;
pub mod workers;
