//! Evaluations on frozen suites: create, list, get, compare and cancel. `view` converts stored evaluations to responses.

pub(super) mod cancel;
pub(super) mod compare;
pub(super) mod create;
pub(super) mod get;
pub(super) mod list;
pub(super) mod scenarios;
mod view;
