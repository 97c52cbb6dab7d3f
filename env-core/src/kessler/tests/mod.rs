//! What kessler is held to.

mod bad_input;
mod critique;
mod critique_laws;
mod critique_tasks;
mod differences;
mod fuzz;
mod golden;
mod laws;
mod observed;
mod planned;
mod reference;
mod staging;
mod tracks;
mod validate_formation;
mod validate_j2;
mod validate_pc;
mod validate_swept;
mod validate_warnings;

use crate::testing::at_level;
