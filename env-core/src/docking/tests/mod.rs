//! Tests of docking: laws, motion, recorded episodes, golden hashes, input and critiques.

mod batch;
mod critique;
mod golden;
mod input;
mod laws;
mod levels;
mod motion;
mod reference;
mod start_rungs;

use crate::testing::at_level;
