//! OpenEnv's routes: as captured, with sessions that last, and for runs.

mod exchanges;
mod judge;
mod sessions;
mod socket;
