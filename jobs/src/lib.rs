//! Jobs as data: the work of the service that can be done anywhere.
//!
//! A job is a pure function of its payload: preparing proposals ([`prepare`]), replaying reported episodes ([`audit`]) and criticising
//! them ([`critique`]). [`design`] has the jobs of designers, of which a language model is no pure function. The crate has no I/O.
//! Rollouts have kinds and envelopes here, and payloads in the crate `rollout`.
//!
//! [`JobPayload::run`] does a job, [`JobPayload::encode`] gives it a compact form, and
//! [`envelope`] has what travels with it: the job's id, its fencing token and the [`world_version`](world_version::world_version),
//! which must be equal on both sides. Queues of jobs are in the crate `job-queue`. Start reading at [`payload`].

pub mod audit;
pub mod critique;
pub mod design;
pub mod envelope;
mod episode_batch;
pub mod kind;
pub mod payload;
pub mod prepare;
pub mod seeds;
#[cfg(test)]
mod tests;
mod wire;
pub mod world_version;

pub use self::episode_batch::{EpisodeBatch, LoggedEpisode};
pub use self::kind::JobKind;
pub use self::payload::{JobContext, JobOutput, JobPayload};
pub use self::wire::WireError;
