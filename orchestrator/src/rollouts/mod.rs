//! Policies that the server rolls out itself.
//!
//! [`settings`] has the policy of a run. A worker leases a group ([`rollout_lease`]), loads it ([`RolloutGroup`]), rolls out its
//! episodes ([`run_episode`]) and writes them as a [`trajectory_group`]. [`push`] counts the group and pushes it to the run's
//! feed in one transaction; trainers claim and acknowledge it by [`feed`]. The worker itself is `workers::rollout`.

pub mod feed;
mod group;
pub mod group_record;
pub mod packed_group;
pub mod push;
mod recorder;
pub mod rollout_lease;
pub mod run_episode;
pub mod settings;

pub use self::group::{RolloutError, RolloutGroup};
pub use self::recorder::{RecordedEpisode, RecordingBudget};
pub use self::settings::Endpoint;
