//! Critiques: finished episodes are examined for the reasons of their losses, which enter the failure profile of the run's task.
//!
//! This happens after the acknowledgement of results. Episodes wait in a durable queue; a job is some episodes of one lease and task.
//! Start reading at [`criticise`] (computing) and [`store_critiques`] (storing).

pub mod criticise;
pub mod critique_input;
pub mod critique_result;
pub mod profile;
pub mod profile_cache;
pub mod sampling;
pub mod store_critiques;
#[cfg(test)]
mod tests;
