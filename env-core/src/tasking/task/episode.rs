//! Implements the episode interface for tasking.

use std::any::Any;

use serde_json::Value;

use super::map::EpisodeMap;
use super::motion::StepMotion;
use super::run::TaskRun;
use super::task_setup::TaskSetup;
use super::telemetry::TaskingTelemetry;
use crate::bracket::EpisodeOutcome;
use crate::error::{ScenarioError, StepError};
use crate::log::JointAction;
use crate::task::{AgentReport, Episode, Scenario, StepReport};

/// An episode of tasking.
pub(super) struct TaskingEpisode {
    run: TaskRun,
    telemetry: TaskingTelemetry,
    /// Motion within the last step, if it is recorded.
    motion: Option<StepMotion>,
}

impl TaskingEpisode {
    pub(super) fn start(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let mut run = TaskRun::start(TaskSetup::read(scenario.recipe())?, scenario.seed())?;
        let telemetry = run.telemetry();
        Ok(Self { run, telemetry, motion: None })
    }
}

impl Episode for TaskingEpisode {
    fn step(&mut self, action: JointAction<'_>, report: &mut StepReport) -> Result<(), StepError> {
        let actions = self.run.read_actions(action)?;
        match &mut self.motion {
            Some(motion) => self.run.step_sampled(&actions, motion),
            None => self.run.step(&actions),
        }
        self.telemetry = self.run.telemetry();
        let last = self.run.last_step();
        report.agents.clear();
        for (agent, reward) in last.rewards.iter().enumerate() {
            if last.were_alive[agent] {
                let is_dead = self.run.is_dead(agent);
                report.agents.push(AgentReport {
                    agent: agent as u32,
                    reward: *reward,
                    terminated: is_dead,
                    truncated: !is_dead && self.run.is_truncated(),
                    needs_action: self.run.needs_action(agent),
                });
            }
        }
        report.reward = last.reward;
        report.elapsed = last.elapsed_s;
        report.done = self.run.is_done();
        Ok(())
    }

    fn steps(&self) -> u32 {
        self.run.sim.steps()
    }

    fn done(&self) -> bool {
        self.run.is_done()
    }

    fn observation(&self) -> &dyn Any {
        &self.telemetry
    }

    fn telemetry(&self) -> Value {
        serde_json::to_value(&self.telemetry).unwrap_or(Value::Null)
    }

    fn write_observation(&self, out: &mut Vec<u8>) {
        let mut value = self.telemetry();
        if let Some(fields) = value.as_object_mut() {
            fields.remove("reward");
            fields.remove("done");
        }
        crate::json_writer::append_json(out, &value);
    }

    fn last_reward(&self) -> f64 {
        self.run.last_step().reward
    }

    fn record_motion(&mut self) {
        self.motion = Some(StepMotion::at_start(&self.run.sim));
    }

    /// The telemetry with the map of the episode, which contains the motion if it is recorded.
    fn truth(&self) -> Value {
        let mut value = self.telemetry();
        let motion = self.motion.clone().unwrap_or_else(|| StepMotion::at_start(&self.run.sim));
        if let (Some(fields), Ok(map)) =
            (value.as_object_mut(), serde_json::to_value(EpisodeMap::new(&self.run, motion)))
        {
            fields.insert("map".to_owned(), map);
        }
        value
    }

    fn outcome(&self) -> EpisodeOutcome {
        self.run.outcome()
    }

    fn state_hash(&self) -> [u8; 32] {
        self.run.sim.state_hash()
    }
}
