//! OpenEnv's routes: as captured, with sessions that last, and for runs.

#![expect(clippy::unwrap_used, reason = "a test that finds something else than it wants must fail")]

mod exchanges;
mod judge;
mod sessions;
mod socket;
