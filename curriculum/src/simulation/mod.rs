//! Simulation of curricula against learners of known ability: the proposals and level moves of a strategy, without a
//! world, a trainer or a day's wait.
//!
//! Start with [`runner`]. One simulation runs on one thread; callers run several in parallel.
//!
//! - [`scenario`]: scenarios that consist of their difficulty alone.
//! - [`learner`]: learners that attempt them, and how their ability grows.
//! - [`trainer`]: trainers that report the learner's results, or some of them.
//! - [`runner`]: a curriculum, a trainer and a learner against each other, as the service would run them.
//! - [`summary`]: the result in numbers.

pub mod learner;
pub mod runner;
pub mod scenario;
pub mod summary;
#[cfg(test)]
mod tests;
pub mod trainer;

pub use learner::{Learner, LearnerKind};
pub use runner::{SimulatedGroup, SimulatedMove, SimulationPlan, SimulationTrace, simulate};
pub use scenario::SyntheticScenario;
pub use summary::SimulationSummary;
pub use trainer::TrainerKind;
