//! docking behind the contract that every world answers to.

use std::any::Any;
use std::cell::OnceCell;

use serde_json::Value;

use super::constants::{MAX_DEPUTIES, STEP_S};
use super::flight::Flight;
use super::reward::Reward;
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

pub(super) struct DockingEpisode {
    flight: Flight,
    rewards: [Reward; MAX_DEPUTIES],
    reward: f64,
    /// Rendered when somebody looks, so that a replay pays nothing for it.
    seen: OnceCell<Telemetry>,
}

impl DockingEpisode {
    pub(super) fn start(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let setup = Setup::read(scenario.recipe())?;
        let start = setup.start(&mut Seeded::new(scenario.seed()))?;
        Ok(Self {
            flight: Flight::new(setup, &start),
            rewards: [Reward::default(); MAX_DEPUTIES],
            reward: 0.0,
            seen: OnceCell::new(),
        })
    }

    fn seen(&self) -> &Telemetry {
        self.seen.get_or_init(|| self.flight.telemetry(&self.rewards, self.reward))
    }
}

impl Episode for DockingEpisode {
    fn step(&mut self, action: JointAction<'_>, report: &mut StepReport) -> Result<(), StepError> {
        let stepped = self.flight.step(action)?;
        (self.rewards, self.reward) = (stepped.rewards, stepped.reward);
        self.seen = OnceCell::new();
        report.agents.clear();
        for (i, (deputy, reward)) in self.flight.deputies().iter().zip(stepped.rewards).enumerate() {
            if !stepped.live_before[i] {
                continue;
            }
            let ends = deputy.ends;
            report.agents.push(AgentReport {
                agent: i as u32,
                reward: reward.total(),
                // A timeout is both: the rules pay −1 for it, so there is nothing to come, and it is the horizon.
                terminated: ends.any(),
                truncated: ends.timeout,
                needs_action: !ends.any(),
            });
        }
        report.reward = stepped.reward;
        report.elapsed = STEP_S;
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

    fn write_observation(&self, out: &mut Vec<u8>) {
        wire::write(out, &Observation(&self.flight, &self.rewards));
    }

    fn last_reward(&self) -> f64 {
        self.reward
    }

    /// Nothing is hidden in this world.
    fn truth(&self) -> Value {
        self.telemetry()
    }

    fn flown(&self) -> Flown {
        self.flight.flown()
    }

    fn state_hash(&self) -> [u8; 32] {
        self.flight.state_hash()
    }
}
