//! Critiques: finished episodes are examined for the reasons of their losses, which enter the failure profile of the run's task.
//!
//! Start reading at [`criticise`].

pub mod criticise;
pub mod profile_cache;
pub mod critique_input;
pub mod profile;
pub mod sampling;
#[cfg(test)]
mod tests;
