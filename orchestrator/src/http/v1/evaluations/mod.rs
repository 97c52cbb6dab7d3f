//! Evaluations on frozen suites.

pub(super) mod begin;
pub(super) mod cancel;
pub(super) mod compare;
pub(super) mod list;
pub(super) mod scenarios;
pub(super) mod show;
mod view;
