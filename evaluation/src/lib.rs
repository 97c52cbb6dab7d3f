//! Frozen suites of held-out scenarios, and the statistics of policies on them.
//!
//! - [`suite`]: frozen sets of held-out scenarios, and their file format.
//! - [`results`]: measures of a policy's episodes; [`suite_rollout`] produces them for built-in policies.
//! - [`bootstrap`]: means with confidence intervals; [`compare`]: two policies on the same scenarios; [`tail`]: the worst
//!   tenth of the scenarios; [`seeds`]: several trainings that differ by their seed.
//! - [`report`]: all of them for one evaluation. Start reading there.
//!
//! The crate knows neither database nor server. The service stores evaluations in its module `evaluations`.

pub mod bootstrap;
pub mod compare;
pub mod report;
pub mod results;
pub mod seeds;
pub mod suite;
pub mod suite_rollout;
pub mod tail;

pub use self::report::EvaluationReport;
pub use self::results::{EpisodeMeasures, PolicyResults};
