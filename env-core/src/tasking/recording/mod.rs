//! Recordings of BSK-RL's episodes, and their replay.
//!
//! The format is that of `scripts/bsk-record` (`docs/reference/bsk-recordings.md`). [`reference`] converts older recordings into it,
//! [`read`] and [`setup`] read it, [`replay`] compares episodes step by step, [`trace`] tick by tick. [`tolerances`] has the largest
//! allowed difference of each quantity.

mod compare;
mod observation;
pub mod read;
pub mod reference;
pub mod replay;
pub mod setup;
mod state;
pub mod tolerances;
mod totals;
mod trace;
mod trace_sample;
mod windows;

pub use self::replay::{compare_recording, is_recording};
