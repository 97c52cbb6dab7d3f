//! Request and response types of the HTTP API `/v1`, one file for each resource.
//!
//! The server, the command line, the benchmarks and the tests share these types, so that the two ends of a request cannot
//! disagree. Their doc comments are the descriptions of the OpenAPI document. Every type implements both `Serialize` and
//! `Deserialize`. A response may gain fields: clients ignore fields that they do not know. A request with an unknown field is
//! rejected.
//!
//! Conversions from database rows, validation and error responses are not here: the `orchestrator` crate has them. Start
//! reading at [`RunSummary`] and [`Lease`].

mod audit_log;
mod columns;
mod critiques;
mod designs;
mod episodes;
mod evaluations;
mod events;
mod failures;
mod layouts;
mod leases;
mod mastery;
mod overview;
mod pages;
mod policy;
mod problem;
mod results;
mod runs;
mod scenarios;
mod series;
mod strategies;
mod suites;
mod trajectories;
mod versions;

pub use self::audit_log::*;
pub use self::columns::*;
pub use self::critiques::*;
pub use self::designs::*;
pub use self::episodes::*;
pub use self::evaluations::*;
pub use self::events::*;
pub use self::failures::*;
pub use self::layouts::*;
pub use self::leases::*;
pub use self::mastery::*;
pub use self::overview::*;
pub use self::pages::*;
pub use self::policy::*;
pub use self::problem::*;
pub use self::results::*;
pub use self::runs::*;
pub use self::scenarios::*;
pub use self::series::*;
pub use self::strategies::*;
pub use self::suites::*;
pub use self::trajectories::*;
pub use self::versions::*;
