//! Implements the episode interface for docking.

use std::any::Any;
use std::cell::OnceCell;

use serde_json::Value;

use super::constants::{MAX_DEPUTIES, STEP_S};
use super::observation::DockingObservation;
use super::reward::DockingReward;
use super::setup::DockingSetup;
use super::simulation::DockingSim;
use super::telemetry::DockingTelemetry;
use crate::bracket::EpisodeOutcome;
use crate::episode_rng::SeededRng;
use crate::error::{ScenarioError, StepError};
use crate::json_writer::append_json;
use crate::log::JointAction;
use crate::task::Scenario;
use crate::task::{AgentReport, Episode, StepReport};

/// An episode of docking.
pub(super) struct DockingEpisode {
    sim: DockingSim,
    rewards: [DockingReward; MAX_DEPUTIES],
    reward: f64,
    /// Created on first use, so that a replay does not pay for it.
    telemetry_cache: OnceCell<DockingTelemetry>,
}

impl DockingEpisode {
    pub(super) fn start(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let setup = DockingSetup::read(scenario.recipe())?;
        let start = setup.sample_starts(&mut SeededRng::new(scenario.seed()))?;
        Ok(Self {
            sim: DockingSim::new(setup, &start),
            rewards: [DockingReward::default(); MAX_DEPUTIES],
            reward: 0.0,
            telemetry_cache: OnceCell::new(),
        })
    }

    fn cached_telemetry(&self) -> &DockingTelemetry {
        self.telemetry_cache.get_or_init(|| self.sim.telemetry(&self.rewards, self.reward))
    }
}

impl Episode for DockingEpisode {
    fn step(&mut self, action: JointAction<'_>, report: &mut StepReport) -> Result<(), StepError> {
        let step = self.sim.step(action)?;
        (self.rewards, self.reward) = (step.rewards, step.reward);
        self.telemetry_cache = OnceCell::new();
        report.agents.clear();
        for (i, (deputy, reward)) in self.sim.deputies().iter().zip(step.rewards).enumerate() {
            if !step.active_before[i] {
                continue;
            }
            let ends = deputy.end_conditions;
            report.agents.push(AgentReport {
                agent: i as u32,
                reward: reward.total(),
                // A timeout is both: it is a rule with a reward of its own (−1), and it is the horizon.
                terminated: ends.any(),
                truncated: ends.timeout,
                needs_action: !ends.any(),
            });
        }
        report.reward = step.reward;
        report.elapsed = STEP_S;
        report.done = step.done;
        Ok(())
    }

    fn steps(&self) -> u32 {
        self.sim.steps()
    }

    fn done(&self) -> bool {
        self.sim.is_done()
    }

    fn observation(&self) -> &dyn Any {
        self.cached_telemetry()
    }

    fn telemetry(&self) -> Value {
        serde_json::to_value(self.cached_telemetry()).unwrap_or(Value::Null)
    }

    fn write_observation(&self, out: &mut Vec<u8>) {
        append_json(out, &DockingObservation { sim: &self.sim, rewards: &self.rewards });
    }

    fn last_reward(&self) -> f64 {
        self.reward
    }

    /// Equals the telemetry, since nothing is hidden in this world.
    fn truth(&self) -> Value {
        self.telemetry()
    }

    fn outcome(&self) -> EpisodeOutcome {
        self.sim.outcome()
    }

    fn state_hash(&self) -> [u8; 32] {
        self.sim.state_hash()
    }
}
