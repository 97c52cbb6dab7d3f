//! Records an episode while it is rolled out, within the memory budget of its group.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use api_types::AgentResult;
use env_core::frames::wire_step;
use env_core::log::Precision;
use env_core::policy::{Policy, PolicyError};
use env_core::task::{AgentReport, Episode, StepReport};
use env_core::{ActionLog, JointAction, Scenario, ScenarioError, StepError, StopReason};
use llm_policy::{Completion, TimeStep};
use serde::{Deserialize, Serialize};
use serde_json::value::{RawValue, to_raw_value};

use crate::step_record::{MAX_GROUP_BYTES, StepRecord};

/// Memory budget of the episodes of a group together: 16 MiB of observations and 16 MiB of conversations. A group that exceeds one
/// of them is delivered without it.
#[derive(Debug)]
pub struct RecordingBudget {
    /// True if observations are recorded.
    records_observations: bool,
    observations: ByteBudget,
    messages: ByteBudget,
}

impl RecordingBudget {
    /// Creates the budget of a group.
    #[must_use]
    pub const fn new(records_observations: bool) -> Self {
        Self {
            records_observations,
            observations: ByteBudget::new(MAX_GROUP_BYTES),
            messages: ByteBudget::new(MAX_GROUP_BYTES),
        }
    }

    /// Returns true if observations exceeded the budget.
    #[must_use]
    pub fn lacks_observations(&self) -> bool {
        self.observations.is_exceeded()
    }

    /// Returns true if conversations exceeded the budget.
    #[must_use]
    pub fn lacks_messages(&self) -> bool {
        self.messages.is_exceeded()
    }

    /// Clears the conversations that do not fit.
    fn limit_messages(&self, completions: &mut [Completion]) {
        for completion in completions {
            let bytes = completion.messages.iter().map(|message| message.content.len()).sum();
            if !self.messages.reserve(bytes) {
                completion.messages.clear();
            }
        }
    }
}

/// Number of bytes that may still be recorded. Once a reservation fails, all later ones do.
#[derive(Debug)]
struct ByteBudget {
    left: AtomicUsize,
    exceeded: AtomicBool,
}

impl ByteBudget {
    const fn new(bytes: usize) -> Self {
        Self { left: AtomicUsize::new(bytes), exceeded: AtomicBool::new(false) }
    }

    /// Reserves bytes; false if they do not fit.
    fn reserve(&self, bytes: usize) -> bool {
        let subtract = |left: usize| left.checked_sub(bytes);
        let fits = !self.is_exceeded()
            && self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, subtract).is_ok();
        if !fits {
            self.exceeded.store(true, Ordering::Relaxed);
        }
        fits
    }

    fn is_exceeded(&self) -> bool {
        self.exceeded.load(Ordering::Relaxed)
    }
}

/// An episode that was rolled out.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RecordedEpisode {
    /// Steps of the episode, in order.
    pub steps: Vec<StepRecord>,
    /// Observation of the agents after the last step, in the wire form.
    pub last_observation: Option<Box<RawValue>>,
    /// Actions of the agents.
    #[serde(with = "log_text")]
    pub log: ActionLog,
}

impl RecordedEpisode {
    /// Returns true if the recorded actions are those of the log, which alone is replayed.
    pub(crate) fn has_actions_of_log(&self) -> bool {
        // Text is compared, because a value of a forged step can be much larger in memory.
        let of_log = self.log.steps().map(|step| Some(wire_step(&self.log, step).to_string()));
        let of_log = of_log.chain(self.log.stopped.map(|_| None));
        let recorded = self.steps.iter().map(|step| step.action.as_deref().map(RawValue::get));
        recorded.map(|action| action.map(str::to_owned)).eq(of_log)
    }
}

/// Text of an action log: its compact form in base64.
mod log_text {
    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;
    use env_core::ActionLog;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(log: &ActionLog, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&STANDARD.encode(log.encode()))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<ActionLog, D::Error> {
        let bytes = STANDARD.decode(String::deserialize(deserializer)?).map_err(Error::custom)?;
        ActionLog::decode(&bytes).map_err(Error::custom)
    }
}

/// An episode that is being rolled out.
pub(crate) struct EpisodeRecorder<'a> {
    budget: &'a RecordingBudget,
    agents: u32,
    episode: Box<dyn Episode>,
    /// Action log; policies append to it.
    pub(crate) log: ActionLog,
    report: StepReport,
    steps: Vec<StepRecord>,
}

impl<'a> EpisodeRecorder<'a> {
    /// Starts an episode of a scenario.
    pub(crate) fn start(scenario: &Scenario, budget: &'a RecordingBudget) -> Result<Self, ScenarioError> {
        let task = scenario.task();
        Ok(Self {
            budget,
            agents: task.agents(scenario.recipe()),
            episode: task.start(scenario)?,
            log: ActionLog::new(task.action_space().dim(), Precision::F64),
            report: StepReport::default(),
            steps: Vec::new(),
        })
    }

    /// Returns true if the episode is over.
    pub(crate) fn is_done(&self) -> bool {
        self.episode.done()
    }

    /// Returns the observation and reward that a model acts on.
    pub(crate) fn time_step(&self) -> TimeStep {
        let (reward, done) = (self.episode.last_reward(), self.episode.done());
        TimeStep { observation: self.episode.telemetry(), reward, done }
    }

    /// Lets a policy act: its actions close a step of the log.
    ///
    /// # Errors
    /// Returns the error of the policy if it has no action.
    pub(crate) fn act(&mut self, policy: &mut dyn Policy) -> Result<(), PolicyError> {
        policy.act(self.episode.observation(), &mut self.log)
    }

    /// Returns the current observation, if it is recorded and fits.
    fn observation(&self) -> Option<Box<RawValue>> {
        if !self.budget.records_observations || self.budget.observations.is_exceeded() {
            return None;
        }
        let mut bytes = Vec::new();
        self.episode.write_observation(&mut bytes);
        if !self.budget.observations.reserve(bytes.len()) {
            return None;
        }
        // A world writes valid JSON.
        String::from_utf8(bytes).ok().and_then(|text| RawValue::from_string(text).ok())
    }

    /// Steps the episode by the newest step of the log. A step that the episode refuses is removed from the log.
    pub(crate) fn step(&mut self, mut completions: Option<Vec<Completion>>) -> Result<(), StepError> {
        self.log.keep_agents(self.agents);
        let at = self.steps.len();
        let observation = self.observation();
        if let Err(error) = self.episode.step(self.log.step(at), &mut self.report) {
            self.log.truncate(at);
            return Err(error);
        }
        if let Some(completions) = &mut completions {
            self.budget.limit_messages(completions);
        }
        // Finite numbers have a JSON form.
        let action = to_raw_value(&wire_step(&self.log, self.log.step(at))).ok();
        let (reward, done) = (self.report.reward, self.report.done);
        let agents = self.agent_results();
        self.steps.push(StepRecord { observation, action, reward, agents, done, error: None, completions });
        Ok(())
    }

    /// Stops the agent: the rest of the episode is stepped by the hold action.
    pub(crate) fn stop(
        &mut self,
        reason: StopReason,
        error: Option<String>,
        mut completions: Vec<Completion>,
    ) -> Result<(), StepError> {
        self.log.stopped = Some(reason);
        let observation = self.observation();
        let mut reward = 0.0;
        while !self.episode.done() {
            self.episode.step(JointAction::HOLD, &mut self.report)?;
            reward += self.report.reward;
        }
        self.budget.limit_messages(&mut completions);
        let (agents, completions) = (self.agent_results(), Some(completions));
        self.steps.push(StepRecord {
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

    fn agent_results(&self) -> Vec<AgentResult> {
        let end = |agent: &AgentReport| AgentResult {
            agent: agent.agent,
            reward: agent.reward,
            terminated: agent.terminated,
            truncated: agent.truncated,
        };
        self.report.agents.iter().map(end).collect()
    }

    /// Returns the recorded episode, with its last observation.
    pub(crate) fn finish(self) -> RecordedEpisode {
        let last_observation = self.observation();
        RecordedEpisode { steps: self.steps, last_observation, log: self.log }
    }
}
