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
use crate::policy::{HoldPolicy, PlanPolicy, Policy, PolicyError, PolicySpec, erase_type};
use crate::seed::{Seed, SeedSpace};
use crate::task::Scenario;

/// The policies in the order of presentation.
pub static DOCKING_POLICIES: [PolicySpec; 6] = [
    PolicySpec { name: "hold", about: "does nothing", chance: false },
    PolicySpec { name: "random", about: "thrusts at random on every axis in every step", chance: true },
    PolicySpec {
        name: "blind",
        about: "thrusts inwards along x for the first 10 s without looking",
        chance: false,
    },
    PolicySpec {
        name: "frozen",
        about: "the trainable reflex at random parameters, untrained",
        chance: true,
    },
    PolicySpec {
        name: "heuristic",
        about: "flies at the chief at 0.85 of the speed limit, and at 0.1 m/s within 3 m",
        chance: false,
    },
    PolicySpec { name: "reference", about: "the planner", chance: false },
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
        "reference" => {
            erase_type::<DockingTelemetry>(PlanPolicy::new(planner::bracket(scenario)?.reference_plan))
        }
        _ => return Err(PolicyError::unknown(name, &DOCKING_POLICIES)),
    })
}

/// Creates the policy that steers every deputy by this law.
#[must_use]
pub fn approach_policy(law: ApproachLaw) -> Box<dyn Policy> {
    erase_type(ApproachPolicy(law))
}
