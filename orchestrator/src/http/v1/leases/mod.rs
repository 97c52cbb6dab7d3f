//! Leases: create, begin groups, list, get, renew and release. `view` converts stored leases to responses.

pub(super) mod begin;
pub(super) mod create;
pub(super) mod get;
pub(super) mod list;
pub(super) mod release;
pub(super) mod renew;
mod view;
