//! Access of ground locations to a satellite: windows of time, and BSK-RL's list of opportunities.

mod arc_search;
pub mod candidates;
mod elevation_curve;
pub mod finder;
pub mod ground_track;
pub mod locations;
mod minimum;
pub mod opportunities;
mod quick_search;
mod root;
pub mod search_error;
mod spline;
pub mod trajectory;
pub mod window_search;

pub use self::finder::{AccessWindow, LocationSet};
pub use self::ground_track::GroundTrack;
pub use self::locations::{AccessLimit, Locations};
pub use self::opportunities::{Opportunity, OpportunityKind, OpportunityList};
pub use self::trajectory::SearchedTrajectory;
