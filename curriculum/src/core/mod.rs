//! Vocabulary and measurements that every strategy shares.
//!
//! Nothing here knows a single strategy's rules; those live in `strategies/`, one file or folder each. Start with
//! `proposal` and `outcome` (what the curriculum returns and receives), then read the trait in `strategy`.
//!
//! - `proposal` leaves the curriculum, `outcome` returns to it, and `event` is what is stored of both.
//! - `evidence`: blocks of outcomes, the posterior over success, and the level moves that rest on them.
//! - `mastery`: the success rate per task and level, as far as contested scenarios show it.
//! - `settings`: tasks, level tables, the strategy and its hyperparameters.
//! - `rungs`: start rungs or levels of a task, on which samplers place proposals. `rung_tracker`: the latest draws and successes
//!   of each rung. `sampler_state`: both as users see them, with what the strategy knows of its next draws.
//!   `probabilities`: those of rungs.
//! - `scale`: the level table as a continuous space. `shares`: how tasks share the proposals.
//! - `strategy`: the trait. `explanation`: status and rules as text. `snapshot`: the stored form of a curriculum.

pub(crate) mod decayed_success;
pub(crate) mod event;
pub(crate) mod evidence;
pub(crate) mod explanation;
pub(crate) mod mastery;
pub(crate) mod outcome;
pub(crate) mod probabilities;
pub(crate) mod proposal;
pub(crate) mod rung_tracker;
pub(crate) mod rungs;
pub(crate) mod sampler_state;
pub(crate) mod scale;
pub(crate) mod settings;
pub(crate) mod shares;
pub(crate) mod slot;
pub(crate) mod snapshot;
pub(crate) mod strategy;
