//! Built-in policies of docking.

mod approach_policy;
mod open_loop;
pub mod reflex;

use self::approach_policy::ApproachPolicy;
use self::open_loop::{BlindThrustPolicy, RandomThrustPolicy};
use self::reflex::DockingReflexParameters;
use super::approach_law::ApproachLaw;
use super::planner;
use super::telemetry::DockingTelemetry;
use crate::policy::{
    HoldPolicy, PLANNER_POLICY, PlanPolicy, Policy, PolicyError, PolicySpec, erase_type, unknown_policy,
};
use crate::seed::{Seed, SeedSpace};
use crate::task::Scenario;

/// The policies in the order of presentation.
pub static DOCKING_POLICIES: [PolicySpec; 6] = [
    PolicySpec { name: "hold", description: "does nothing", stochastic: false },
    PolicySpec {
        name: "random",
        description: "thrusts at random on every axis in every step",
        stochastic: true,
    },
    PolicySpec {
        name: "blind",
        description: "thrusts inwards along x for the first 10 s without looking",
        stochastic: false,
    },
    PolicySpec {
        name: "frozen",
        description: "the trainable reflex at random parameters, untrained",
        stochastic: true,
    },
    PolicySpec {
        name: "heuristic",
        description: "flies at the chief at 0.85 of the speed limit, and at 0.1 m/s within 3 m",
        stochastic: false,
    },
    PolicySpec { name: PLANNER_POLICY, description: "the planner", stochastic: false },
];

/// Creates a policy by name.
///
/// # Errors
/// Returns an error if the name is unknown or, for `reference`, if the start of the scenario cannot be sampled.
pub fn create_policy(name: &str, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError> {
    let seed = Seed::in_space(SeedSpace::User, seed);
    Ok(match name {
        "hold" => erase_type::<DockingTelemetry>(HoldPolicy),
        "random" => erase_type(RandomThrustPolicy::new(seed)),
        "blind" => erase_type(BlindThrustPolicy),
        "frozen" => approach_policy(DockingReflexParameters::random(seed).approach()),
        "heuristic" => approach_policy(ApproachLaw::HEURISTIC),
        PLANNER_POLICY => {
            erase_type::<DockingTelemetry>(PlanPolicy::new(planner::bracket(scenario)?.reference_plan))
        }
        _ => return Err(unknown_policy(name, &DOCKING_POLICIES)),
    })
}

/// Creates the policy that steers every deputy by this law.
#[must_use]
pub fn approach_policy(law: ApproachLaw) -> Box<dyn Policy> {
    erase_type(ApproachPolicy(law))
}
