//! Evaluations on frozen suites: begun, flown by a trainer in leases or by the server, and read.

pub mod begin;
pub mod cancel;
pub mod fill;
pub mod lease;
pub mod read;

pub use begin::{BeginEvaluation, EvaluationWish};
pub use cancel::CancelEvaluation;
