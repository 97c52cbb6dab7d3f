//! Policies that the server flies itself: which, for which run ([`settings`]), how a group is flown ([`fly`]), what is told
//! of it ([`body`]), how it is counted and pushed to the feed in one transaction ([`push`]), and how the feed is pulled and
//! acknowledged ([`feed`]).

pub mod body;
pub mod feed;
pub mod fly;
mod group;
pub mod push;
pub mod settings;
pub mod take;
mod tape;

pub use self::group::{FlyError, Ground};
pub use self::settings::{Endpoint, PolicySettings, PolicyWish};
