//! Evaluations of policies on frozen suites, as the service stores them: [`begin`], [`cancel`], [`lease`], [`store_results`]
//! and [`read`].
//!
//! Suites and statistics are in the crate `evaluation`.

pub mod begin;
pub mod cancel;
pub mod lease;
pub mod read;
pub mod store_results;
