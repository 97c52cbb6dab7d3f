//! Access of ground locations to a satellite: windows of time, and BSK-RL's list of opportunities.

mod arc_search;
pub mod finder;
pub mod ground_track;
pub mod opportunities;
pub mod search_error;

pub use self::finder::{AccessLimit, AccessWindow, LocationSet, Locations};
pub use self::ground_track::GroundTrack;
pub use self::opportunities::{Opportunity, OpportunityKind, OpportunityList};
