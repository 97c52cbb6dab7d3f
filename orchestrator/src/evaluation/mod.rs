//! What a policy is worth, so that it can be defended: frozen suites, what was flown on them, and what may be said of it.
//!
//! - [`suite`]: frozen sets of held-out scenarios.
//! - [`fly`]: built-in policies on a suite; [`Flown`] is what any policy did there.
//! - [`bootstrap`]: means with intervals. [`compare`]: two policies on the same scenarios. [`tail`]: the worst of them.
//!   [`seeds`]: several trainings of the same kind.

pub mod bootstrap;
pub mod compare;
pub mod flown;
pub mod fly;
pub mod report;
pub mod seeds;
pub mod suite;
pub mod tail;

pub use flown::{Flown, Measures};
pub use report::Report;
