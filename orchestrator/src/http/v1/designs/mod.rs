//! Designs of a run: their state, their results, and requests to designers. `view` converts stored designs to responses.

pub(super) mod create_request;
pub(super) mod get;
pub(super) mod list;
pub(super) mod requests;
pub(super) mod retire;
pub(super) mod statistics;
pub(super) mod view;
