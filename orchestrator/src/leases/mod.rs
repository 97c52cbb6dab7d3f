//! Leases: scenarios are prepared ahead, and groups of them are leased, renewed, released and expired.
//!
//! What happens with the results of a lease lives in `results/`. Start reading at [`lease_service`], then [`create`].

pub mod audit_sample;
pub mod begin;
pub mod bracket_view;
pub mod columns;
pub mod create;
pub mod end;
pub mod end_lease;
pub mod eval;
pub mod find;
mod group_row;
pub mod lease_service;
pub mod proposal_queue;
pub mod refill;
pub mod renew;
pub mod scenario_cache;
pub(crate) mod session_episodes;
pub(crate) mod slots;
pub mod store_prepared;
