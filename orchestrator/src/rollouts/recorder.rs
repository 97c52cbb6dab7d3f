//! One episode while it is flown, and what is kept of it.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use env_core::log::Precision;
use env_core::task::{Episode, StepReport};
use env_core::{ActionLog, JointAction, Scenario, ScenarioError, StepError, StopReason};
use serde::Serialize;
use serde_json::Value;
use serde_json::value::RawValue;
use utoipa::ToSchema;

use crate::rollouts::trajectory_group::MOST_BYTES;
use crate::frames::wire_step;
use crate::policy::{Completion, TimeStep};

/// One step of an episode.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct TrajectoryStep {
    /// What the agents were told before it, in the wire form.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub observation: Option<Box<RawValue>>,
    /// What they did, as results have it: a list of `[agent, value, …]`. None where the agent gave none: the episode was
    /// stopped there.
    #[schema(value_type = Option<Vec<Vec<f64>>>)]
    pub action: Option<Value>,
    /// The team's reward. Of the step at which the episode was stopped: all that doing nothing earned from there on.
    pub reward: f64,
    /// Every agent that was alive before it.
    pub agents: Vec<AgentEnd>,
    /// The episode is over.
    pub done: bool,
    /// Why the agent gave no action.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// How a language model came to it: one call, or two where its first answer was repaired.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Object>>)]
    pub completions: Option<Vec<Completion>>,
}

/// How a step ended for an agent.
#[derive(Debug, Clone, Copy, Serialize, ToSchema)]
pub struct AgentEnd {
    /// Who.
    agent: u32,
    /// Its own reward.
    reward: f64,
    /// It has left the episode by the rules of the task.
    terminated: bool,
    /// The episode was cut off by its horizon.
    truncated: bool,
}

/// How much is kept of all episodes of a group together: a group that is too large is told without.
#[derive(Debug)]
pub struct RecordingBudget {
    /// Whether observations are wanted.
    wanted: bool,
    observations: Bytes,
    messages: Bytes,
}

#[derive(Debug)]
struct Bytes {
    left: AtomicUsize,
    out: AtomicBool,
}

impl Bytes {
    const fn new(most: usize) -> Self {
        Self { left: AtomicUsize::new(most), out: AtomicBool::new(false) }
    }

    fn take(&self, bytes: usize) -> bool {
        let less = |left: usize| left.checked_sub(bytes);
        let fits =
            !self.is_out() && self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, less).is_ok();
        if !fits {
            self.out.store(true, Ordering::Relaxed);
        }
        fits
    }

    fn is_out(&self) -> bool {
        self.out.load(Ordering::Relaxed)
    }
}

impl RecordingBudget {
    /// Room for a group; for its observations where they are wanted.
    #[must_use]
    pub const fn new(observations: bool) -> Self {
        Self { wanted: observations, observations: Bytes::new(MOST_BYTES), messages: Bytes::new(MOST_BYTES) }
    }

    /// Observations were more than there is room for.
    #[must_use]
    pub fn lacks_observations(&self) -> bool {
        self.observations.is_out()
    }

    /// Conversations were more than there is room for.
    #[must_use]
    pub fn lacks_messages(&self) -> bool {
        self.messages.is_out()
    }

    /// Conversations are kept as long as there is room.
    fn keep(&self, completions: &mut [Completion]) {
        for completion in completions {
            let bytes = completion.messages.iter().map(|message| message.content.len()).sum();
            if !self.messages.take(bytes) {
                completion.messages.clear();
            }
        }
    }
}

/// An episode that was flown.
#[derive(Debug)]
pub struct RecordedEpisode {
    /// Step by step.
    pub steps: Vec<TrajectoryStep>,
    /// What the agents were told at its end.
    pub last: Option<Box<RawValue>>,
    /// What they did.
    pub log: ActionLog,
}

/// An episode that is being flown.
pub(crate) struct EpisodeRecorder<'a> {
    room: &'a RecordingBudget,
    agents: u32,
    episode: Box<dyn Episode>,
    /// Policies append to it.
    pub(crate) log: ActionLog,
    report: StepReport,
    steps: Vec<TrajectoryStep>,
}

impl<'a> EpisodeRecorder<'a> {
    pub(crate) fn begin(scenario: &Scenario, room: &'a RecordingBudget) -> Result<Self, ScenarioError> {
        let task = scenario.task();
        Ok(Self {
            room,
            agents: task.agents(scenario.recipe()),
            episode: task.start(scenario)?,
            log: ActionLog::new(task.action_space().columns.len(), Precision::F64),
            report: StepReport::default(),
            steps: Vec::new(),
        })
    }

    pub(crate) fn done(&self) -> bool {
        self.episode.done()
    }

    /// What a model is told.
    pub(crate) fn seen(&self) -> TimeStep {
        let (reward, done) = (self.episode.last_reward(), self.episode.done());
        TimeStep { observation: self.episode.telemetry(), reward, done }
    }

    /// A built-in policy decides: its actions close a step of the log.
    pub(crate) fn ask(&mut self, policy: &mut dyn env_core::policy::Policy) {
        policy.act(self.episode.observation(), &mut self.log);
    }

    fn observed(&self) -> Option<Box<RawValue>> {
        if !self.room.wanted || self.room.observations.is_out() {
            return None;
        }
        let mut bytes = Vec::new();
        self.episode.write_observation(&mut bytes);
        if !self.room.observations.take(bytes.len()) {
            return None;
        }
        // What the world writes is JSON.
        String::from_utf8(bytes).ok().and_then(|text| RawValue::from_string(text).ok())
    }

    /// Flies the newest step of the log.
    pub(crate) fn step(&mut self, mut completions: Option<Vec<Completion>>) -> Result<(), StepError> {
        self.log.keep_agents(self.agents);
        let at = self.steps.len();
        let observation = self.observed();
        if let Err(error) = self.episode.step(self.log.step(at), &mut self.report) {
            self.log.truncate(at);
            return Err(error);
        }
        if let Some(completions) = &mut completions {
            self.room.keep(completions);
        }
        let action = Some(wire_step(&self.log, self.log.step(at)));
        let (reward, done) = (self.report.reward, self.report.done);
        let agents = self.ends();
        self.steps.push(TrajectoryStep {
            observation,
            action,
            reward,
            agents,
            done,
            error: None,
            completions,
        });
        Ok(())
    }

    /// The agent goes no further: the rest is flown as hold.
    pub(crate) fn stop(
        &mut self,
        why: StopReason,
        error: Option<String>,
        mut completions: Vec<Completion>,
    ) -> Result<(), StepError> {
        self.log.stopped = Some(why);
        let observation = self.observed();
        let mut reward = 0.0;
        while !self.episode.done() {
            self.episode.step(JointAction::HOLD, &mut self.report)?;
            reward += self.report.reward;
        }
        self.room.keep(&mut completions);
        let (agents, completions) = (self.ends(), Some(completions));
        self.steps.push(TrajectoryStep {
            observation,
            action: None,
            reward,
            agents,
            done: true,
            error,
            completions,
        });
        Ok(())
    }

    fn ends(&self) -> Vec<AgentEnd> {
        let end = |agent: &env_core::task::AgentReport| AgentEnd {
            agent: agent.agent,
            reward: agent.reward,
            terminated: agent.terminated,
            truncated: agent.truncated,
        };
        self.report.agents.iter().map(end).collect()
    }

    pub(crate) fn end(self) -> RecordedEpisode {
        let last = self.observed();
        RecordedEpisode { steps: self.steps, last, log: self.log }
    }
}
