//! The feed of a run: groups that the server has flown, pulled and acknowledged.

pub(super) mod ack;
mod answer;
pub(super) mod pull;
