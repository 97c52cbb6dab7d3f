//! A finished group of a trajectory feed, as it is recorded and written.
//!
//! Its JSON is that of `api_types::TrajectoryGroup`. Observations stay JSON text, so that they are written once.

use api_types::{
    ActionStopReason, GroupRole, MessageContent, ObservationContent, ScenarioBracket, TrajectoryMetrics,
};
use serde::Serialize;
use serde_json::Value;
use serde_json::value::RawValue;

use rollout::StepRecord;

/// A finished group, without its id in the feed and the number of its deliveries.
#[derive(Debug, Serialize)]
pub struct GroupRecord {
    /// Id of the run.
    pub run: String,
    /// Id of the lease that the group was rolled out under.
    pub lease: String,
    /// Number of the group in its lease.
    pub group: i64,
    /// Id of the task.
    pub task: String,
    /// Level of the scenario, if the task has levels.
    pub level: Option<i64>,
    /// `placement`, `frontier`, `rehearsal`, `sample` or `designed`.
    pub role: GroupRole,
    /// Id of the layout, if the scenario was designed.
    pub layout: Option<String>,
    /// The scenario without its seed: world, task, params, physics, layout.
    pub recipe: Value,
    /// The seed that makes the recipe a scenario.
    pub seed: u64,
    /// Id of the scenario.
    pub scenario: String,
    /// True if acting well matters on this scenario.
    pub contested: bool,
    /// Floor and reference of the scenario. For the trainer, never for the agent.
    pub bracket: ScenarioBracket,
    /// The policy that was rolled out.
    pub policy: String,
    /// Version of the policy.
    pub policy_version: i64,
    /// `telemetry`, `none` (as configured), or `dropped`: with them the group would be larger than 16 MiB.
    pub observations: ObservationContent,
    /// `none`: a built-in policy has no conversations; `kept`; or `dropped` like observations.
    pub messages: MessageContent,
    /// Episodes that the infrastructure lost: they are not in `episodes`, and do not count.
    pub failed: usize,
    /// Episodes that finished, in order.
    pub episodes: Vec<EpisodeRecord>,
}

/// A finished episode of a group.
#[derive(Debug, Serialize)]
pub struct EpisodeRecord {
    /// Id of the episode.
    pub id: String,
    /// The score, by replay.
    pub score: f64,
    /// The skill, where the scenario defines one.
    pub skill: Option<f64>,
    /// True if the episode is a success by the run's rule.
    pub success: bool,
    /// Why the agent was stopped: `unparsable`, `too_long` or `too_late`.
    pub stopped: Option<ActionStopReason>,
    /// Metrics of the language model; left out for a built-in policy.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metrics: Option<TrajectoryMetrics>,
    /// Steps of the episode, in order.
    pub steps: Vec<StepRecord>,
    /// Observation of the agents after the last step, in the wire form.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub last_observation: Option<Box<RawValue>>,
}

impl GroupRecord {
    /// Removes the observations of every step.
    pub fn drop_observations(&mut self) {
        self.observations = ObservationContent::Dropped;
        for episode in &mut self.episodes {
            episode.last_observation = None;
            episode.steps.iter_mut().for_each(|step| step.observation = None);
        }
    }

    /// Removes the conversations; the model's answers are kept.
    pub fn drop_messages(&mut self) {
        self.messages = MessageContent::Dropped;
        let steps = self.episodes.iter_mut().flat_map(|episode| &mut episode.steps);
        for completion in steps.filter_map(|step| step.completions.as_mut()).flatten() {
            completion.messages.clear();
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use api_types::{AgentResult, TrajectoryGroup};
    use llm::{Message, Role, TokenDetails};
    use llm_policy::Completion;
    use serde_json::{json, to_value};

    use super::*;

    fn raw(text: &str) -> Option<Box<RawValue>> {
        RawValue::from_string(text.to_owned()).ok()
    }

    fn step_with_all_fields() -> StepRecord {
        let completion = Completion {
            messages: [Role::System, Role::User, Role::Assistant]
                .map(|role| Message::new(role, "text"))
                .to_vec(),
            text: Some("burn".to_owned()),
            truncated: true,
            error: Some("no action".to_owned()),
            tokens_in: 3,
            tokens_out: 4,
            latency_ms: 5,
            tokens: Some(TokenDetails {
                prompt: Some(vec![1]),
                completion: Some(vec![2]),
                logprobs: Some(vec![-0.5]),
            }),
        };
        StepRecord {
            observation: raw(r#"{"step":0}"#),
            action: raw("[[0,0.5,0.25]]"),
            reward: 0.5,
            agents: vec![AgentResult { agent: 0, reward: 0.5, terminated: false, truncated: true }],
            done: true,
            error: Some("too late".to_owned()),
            completions: Some(vec![completion]),
        }
    }

    /// Group in which every optional field is present.
    pub(in crate::rollouts) fn group_with_all_fields() -> GroupRecord {
        let episode = EpisodeRecord {
            id: "ep_1-abcdef_0".to_owned(),
            score: 0.5,
            skill: Some(0.25),
            success: true,
            stopped: Some(ActionStopReason::TooLate),
            metrics: Some(TrajectoryMetrics { temperature: Some(0.5), ..TrajectoryMetrics::default() }),
            steps: vec![step_with_all_fields()],
            last_observation: raw(r#"{"step":1}"#),
        };
        GroupRecord {
            run: "r".to_owned(),
            lease: "1-abcdef".to_owned(),
            group: 0,
            task: "kessler/survival".to_owned(),
            level: Some(1),
            role: GroupRole::Frontier,
            layout: Some("layout-1".to_owned()),
            recipe: json!({"task": "kessler/survival"}),
            seed: 1,
            scenario: "s".to_owned(),
            contested: true,
            bracket: ScenarioBracket {
                planner_version: 1,
                floor: 0.1,
                hold: 0.1,
                reference: 0.9,
                panel_successes: 1,
                panel_size: 16,
            },
            policy: "chat".to_owned(),
            policy_version: 2,
            observations: ObservationContent::Telemetry,
            messages: MessageContent::Kept,
            failed: 1,
            episodes: vec![episode],
        }
    }

    #[test]
    fn written_group_is_the_type_of_the_api() {
        let written = to_value(group_with_all_fields()).unwrap();
        let group: TrajectoryGroup = serde_json::from_value(written.clone()).unwrap();
        assert_eq!(to_value(group).unwrap(), written);
    }
}
