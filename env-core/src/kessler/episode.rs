//! Episode of kessler behind the trait that all worlds implement.

use std::any::Any;
use std::cell::OnceCell;

use serde_json::Value;

use super::observation::KesslerObservation;
use super::reward::Objective;
use super::setup::KesslerSetup;
use super::simulation::KesslerSim;
use super::telemetry::KesslerTelemetry;
use crate::bracket::EpisodeOutcome;
use crate::episode_rng::SeededRng;
use crate::error::{ScenarioError, StepError};
use crate::json_writer::append_json;
use crate::log::JointAction;
use crate::task::Scenario;
use crate::task::{AgentReport, Episode, StepReport};

/// Episode in progress, with its last reward.
pub(super) struct KesslerEpisode {
    sim: KesslerSim<SeededRng>,
    reward: f64,
    /// Telemetry of the current step. It is built on first use, so that a replay does not pay for it.
    telemetry: OnceCell<KesslerTelemetry>,
}

impl KesslerEpisode {
    /// Starts the episode of a scenario.
    ///
    /// # Errors
    /// Returns [`ScenarioError`] if the recipe is invalid or has no fair start.
    pub(super) fn start(objective: Objective, scenario: &Scenario) -> Result<Self, ScenarioError> {
        let setup = KesslerSetup::from_recipe(scenario.recipe())?;
        let mut rng = SeededRng::new(scenario.seed());
        let start = setup.draw_initial_state(&mut rng)?;
        Ok(Self {
            sim: KesslerSim::new(objective, setup, &start, rng),
            reward: 0.0,
            telemetry: OnceCell::new(),
        })
    }

    fn current_telemetry(&self) -> &KesslerTelemetry {
        self.telemetry.get_or_init(|| self.sim.telemetry(self.reward, false))
    }
}

impl Episode for KesslerEpisode {
    fn step(&mut self, action: JointAction<'_>, report: &mut StepReport) -> Result<(), StepError> {
        let stepped = self.sim.step(action)?;
        self.reward = stepped.reward;
        self.telemetry = OnceCell::new();
        report.agents.clear();
        for (agent, satellite) in (0u32..).zip(self.sim.satellites()) {
            if stepped.active_before[agent as usize] {
                let alive = satellite.is_active();
                report.agents.push(AgentReport {
                    agent,
                    reward: stepped.reward,
                    terminated: !alive,
                    truncated: alive && stepped.done,
                    needs_action: alive && !stepped.done,
                });
            }
        }
        report.reward = stepped.reward;
        report.elapsed = 1.0;
        report.done = stepped.done;
        Ok(())
    }

    fn steps(&self) -> u32 {
        self.sim.steps()
    }

    fn done(&self) -> bool {
        self.sim.is_done()
    }

    fn observation(&self) -> &dyn Any {
        self.current_telemetry()
    }

    fn telemetry(&self) -> Value {
        serde_json::to_value(self.current_telemetry()).unwrap_or(Value::Null)
    }

    fn conjunctions(&self) -> Option<Value> {
        serde_json::to_value(self.sim.forecast_conjunctions(false)).ok()
    }

    fn write_observation(&self, out: &mut Vec<u8>) {
        append_json(out, &KesslerObservation(&self.sim));
    }

    fn last_reward(&self) -> f64 {
        self.reward
    }

    fn truth(&self) -> Value {
        serde_json::to_value(self.sim.telemetry(self.reward, true)).unwrap_or(Value::Null)
    }

    fn outcome(&self) -> EpisodeOutcome {
        self.sim.outcome()
    }

    fn state_hash(&self) -> [u8; 32] {
        self.sim.state_hash()
    }
}
