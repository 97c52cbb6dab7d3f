//! Rollouts of policies, in the server and in workers on other machines.
//!
//! A [`RolloutJob`] has the scenario, the policy and the seeds of a group. [`PolicySources`] rolls its episodes out by the policies of
//! this process, and returns a [`RolledOutGroup`]: action logs, recorded steps, and the reasons why episodes were lost. `run_episode`
//! alone decides whether a failure is the agent's or the infrastructure's. Jobs and groups have a form for messages. No endpoint, key or
//! path is part of a job. Leases, replays and the feed are the service's. Start reading at [`PolicySources::roll_out`].

mod group;
mod job;
mod policy_sources;
mod recorder;
mod run_episode;
mod step_record;
#[cfg(test)]
mod tests;
mod wire_error;

pub use self::group::RolledOutGroup;
pub use self::job::{ChatSampling, RolloutJob, RolloutPolicy};
pub use self::policy_sources::{Endpoint, PolicySources, RolloutFailure};
pub use self::recorder::{RecordedEpisode, RecordingBudget};
pub use self::run_episode::RolloutOutcome;
pub use self::step_record::{MAX_GROUP_BYTES, StepRecord};
pub use self::wire_error::RolloutWireError;
