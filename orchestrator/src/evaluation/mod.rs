//! Evaluations of policies on frozen suites of held-out scenarios.
//!
//! Statistics, which know neither database nor server:
//! - [`suite`]: frozen sets of held-out scenarios, and their file format.
//! - [`results`]: measures of a policy's episodes; [`suite_rollout`] produces them for built-in policies.
//! - [`bootstrap`]: means with confidence intervals; [`compare`]: two policies on the same scenarios; [`tail`]: the worst
//!   tenth of the scenarios; [`seeds`]: several trainings that differ by their seed.
//! - [`report`]: all of them for one evaluation. Start reading there.
//!
//! Use cases of the service, which store evaluations: [`begin`], [`cancel`], [`lease`], [`fill`] and [`read`].

pub mod begin;
pub mod bootstrap;
pub mod cancel;
pub mod compare;
pub mod lease;
pub mod read;
pub mod report;
pub mod results;
pub mod seeds;
pub mod store_results;
pub mod suite;
pub mod suite_rollout;
pub mod tail;

pub use self::report::EvaluationReport;
pub use self::results::{EpisodeMeasures, PolicyResults};
