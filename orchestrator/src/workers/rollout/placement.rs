//! Decides where the next group of a policy is rolled out: by a worker on another machine, or by this server.

use jobs::JobKind;
use rollout::RolloutPolicy;
use store::run_policies::{RunPolicy, RunPolicyRow};

use super::{ActiveGroups, RolloutWorker};

/// Maximum number of concurrent groups of built-in policies here: one is replayed and stored while another is rolled out.
pub(super) const MAX_BUILT_IN_GROUPS: usize = 2;

/// Place of a rollout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RolloutPlace {
    /// The server that leases the group.
    Here,
    /// A worker on another machine.
    Worker,
}

/// Place of the next group of a policy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Placement {
    /// The group may start.
    Start(RolloutPlace),
    /// All places are busy.
    Busy,
    /// Neither the server nor a worker has the language model. A worker may join at any time.
    NoModel(&'static str),
    /// The language model of the server does not answer.
    ModelAway(String),
}

/// Kind of the jobs that roll out a policy.
pub(super) fn rollout_kind(policy: &RunPolicy) -> JobKind {
    match policy {
        RunPolicy::Chat => JobKind::RolloutChat,
        RunPolicy::Off | RunPolicy::BuiltIn(_) => RolloutPolicy::Reference(policy.to_string()).kind(),
    }
}

impl RolloutWorker {
    /// Decides where the next group of a policy is rolled out. A worker comes first, so that the server stays free for requests.
    pub(super) fn place(&self, active: &ActiveGroups, row: &RunPolicyRow) -> Placement {
        let kind = rollout_kind(&row.policy);
        let room = self.remote.as_ref().map_or(0, |remote| remote.room(kind));
        if active.load(RolloutPlace::Worker, kind) < room {
            return Placement::Start(RolloutPlace::Worker);
        }
        if kind == JobKind::RolloutChat {
            return self.place_chat_here(active, room);
        }
        // Files and built-in policies share the threads.
        let kinds = [JobKind::RolloutBuiltIn, JobKind::RolloutFile];
        let here: usize = kinds.into_iter().map(|kind| active.load(RolloutPlace::Here, kind)).sum();
        if here < MAX_BUILT_IN_GROUPS { Placement::Start(RolloutPlace::Here) } else { Placement::Busy }
    }

    fn place_chat_here(&self, active: &ActiveGroups, remote_room: usize) -> Placement {
        let Some(endpoint) = &self.policies.endpoint else {
            return match (remote_room, &self.remote) {
                (0, Some(_)) => Placement::NoModel(
                    "neither the server nor a connected worker has a language model for the policy chat; start one of them with --policy-url and --policy-model (sparring worker --jobs rollout)",
                ),
                (0, None) => Placement::NoModel(
                    "the server has no language model for the policy chat; start it with --policy-url and --policy-model",
                ),
                _ => Placement::Busy,
            };
        };
        let health = endpoint.llm.health();
        if health.retry_in_s.is_some_and(|left| left > 0.0) {
            let reason = health.breaker_error.unwrap_or_default();
            return Placement::ModelAway(format!("calls of the model are paused: {reason}"));
        }
        // A few more episodes than concurrent calls, so that no call waits for the slowest episode of a group.
        let episodes = active.load(RolloutPlace::Here, JobKind::RolloutChat);
        if episodes >= endpoint.llm.config().concurrency {
            return Placement::Busy;
        }
        Placement::Start(RolloutPlace::Here)
    }
}
