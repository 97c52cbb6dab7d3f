//! OpenEnv's routes: conformance with captured exchanges, sessions, episodes of runs, and judges.

mod captured_exchanges;
mod harness;
mod judge;
mod recorded_exchanges;
mod run_sessions;
mod sessions;
pub(crate) mod socket;
