//! Policies that the server flies itself: which, for which run ([`settings`]), how a group is flown ([`fly`]), what is told
//! of it ([`body`]), how it is counted and pushed to the feed in one transaction ([`push`]), and how the feed is pulled and
//! acknowledged ([`feed`]).

pub mod trajectory_group;
pub mod feed;
pub mod run_episode;
mod group;
pub mod push;
pub mod settings;
pub mod rollout_lease;
mod recorder;

pub use self::group::{RolloutError, RolloutGroup};
pub use self::settings::{Endpoint, PolicySettings, PolicyRequest};
