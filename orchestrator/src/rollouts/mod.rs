//! Policies that the server rolls out itself.
//!
//! [`settings`] has the policy of a run. A worker leases a group ([`rollout_lease`]), loads it ([`RolloutGroup`]), lets the crate
//! `rollout` roll out its episodes, here or in a worker on another machine, and writes them as a [`group_record`]. [`push`] counts the group and pushes it to the run's
//! feed in one transaction; trainers claim and acknowledge it by [`feed`]. The worker itself is `workers::rollout`.

pub mod feed;
mod group;
pub mod group_record;
pub mod packed_group;
pub mod push;
pub mod rollout_lease;
pub mod settings;

pub use self::group::{RolloutError, RolloutGroup};
