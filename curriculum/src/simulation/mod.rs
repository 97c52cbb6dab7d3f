//! Curricula against learners whose ability is known: what a strategy proposes, and when it moves, without a world, a trainer or a
//! day's wait.
//!
//! - [`synthetic`]: scenarios that are nothing but how hard they are.
//! - [`learner`]: who flies them, and how ability grows.
//! - [`drive`]: a run of both against each other, as the service would do it.
//! - [`summary`]: what came of it, in numbers.

pub mod drive;
pub mod learner;
pub mod summary;
pub mod synthetic;
#[cfg(test)]
mod tests;

pub use drive::{Plan, Track, simulate};
pub use learner::{Learner, LearnerKind};
pub use summary::Summary;
