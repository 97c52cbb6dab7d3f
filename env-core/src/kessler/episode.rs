//! kessler behind the contract that every world answers to.

use std::any::Any;
use std::cell::OnceCell;

use serde_json::Value;

use super::flight::Flight;
use super::reward::Objective;
use super::setup::Setup;
use super::telemetry::Telemetry;
use super::wire::Observation;
use crate::bracket::Flown;
use crate::chance::Seeded;
use crate::error::{ScenarioError, StepError};
use crate::log::JointAction;
use crate::scenario::Scenario;
use crate::task::{AgentReport, Episode, StepReport};
use crate::wire;

pub(super) struct KesslerEpisode {
    flight: Flight<Seeded>,
    reward: f64,
    /// Rendered when somebody looks, so that a replay pays nothing for it.
    seen: OnceCell<Telemetry>,
}

impl KesslerEpisode {
    pub(super) fn start(objective: Objective, scenario: &Scenario) -> Result<Self, ScenarioError> {
        let setup = Setup::read(scenario.recipe())?;
        let mut chance = Seeded::new(scenario.seed());
        let start = setup.start(&mut chance)?;
        Ok(Self { flight: Flight::new(objective, setup, &start, chance), reward: 0.0, seen: OnceCell::new() })
    }

    fn seen(&self) -> &Telemetry {
        self.seen.get_or_init(|| self.flight.telemetry(self.reward, false))
    }
}

impl Episode for KesslerEpisode {
    fn step(&mut self, action: JointAction<'_>, report: &mut StepReport) -> Result<(), StepError> {
        let stepped = self.flight.step(action)?;
        self.reward = stepped.reward;
        self.seen = OnceCell::new();
        report.agents.clear();
        for (agent, satellite) in (0u32..).zip(self.flight.satellites()) {
            if stepped.active_before[agent as usize] {
                let alive = satellite.active();
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
        self.flight.steps()
    }

    fn done(&self) -> bool {
        self.flight.done()
    }

    fn observation(&self) -> &dyn Any {
        self.seen()
    }

    fn telemetry(&self) -> Value {
        serde_json::to_value(self.seen()).unwrap_or(Value::Null)
    }

    fn conjunctions(&self) -> Option<Value> {
        serde_json::to_value(self.flight.foreseen(false)).ok()
    }

    fn write_observation(&self, out: &mut Vec<u8>) {
        wire::write(out, &Observation(&self.flight));
    }

    fn last_reward(&self) -> f64 {
        self.reward
    }

    fn truth(&self) -> Value {
        serde_json::to_value(self.flight.telemetry(self.reward, true)).unwrap_or(Value::Null)
    }

    fn flown(&self) -> Flown {
        self.flight.flown()
    }

    fn state_hash(&self) -> [u8; 32] {
        self.flight.state_hash()
    }
}
