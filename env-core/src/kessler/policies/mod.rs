//! Policies without a model, for kessler.

mod heuristic;
pub mod learner;
mod simple;

use self::heuristic::Heuristic;
use self::learner::{Learner, Parameters};
use self::simple::{Blind, Random};
use super::planner;
use super::reward::Objective;
use super::telemetry::Telemetry;
use crate::policy::{Hold, Policy, PolicyError, PolicySpec, Witness, seated};
use crate::scenario::Scenario;
use crate::seed::Seed;

/// The policies, in the order people should read them.
pub static SPECS: [PolicySpec; 6] = [
    PolicySpec { name: "hold", about: "does nothing", chance: false },
    PolicySpec { name: "random", about: "burns at random on every axis in every step", chance: true },
    PolicySpec {
        name: "blind",
        about: "one fixed radial kick of 0.2 LU/TU at the first step",
        chance: false,
    },
    PolicySpec { name: "frozen", about: "the trainable reflex at random numbers, untrained", chance: true },
    PolicySpec { name: "heuristic", about: "looks ahead and dodges what it sees", chance: false },
    PolicySpec { name: "reference", about: "the planner, with hindsight", chance: false },
];

/// A policy by name.
///
/// # Errors
/// An unknown name, or (for the reference) a scenario whose start is not fair.
pub fn by_name(
    name: &str,
    objective: Objective,
    scenario: &Scenario,
    seed: u64,
) -> Result<Box<dyn Policy>, PolicyError> {
    let seed = Seed::in_space(crate::seed::SeedSpace::User, seed);
    Ok(match name {
        "hold" => seated::<Telemetry>(Hold),
        "random" => seated(Random::new(seed)),
        "blind" => seated(Blind::new()),
        "frozen" => seated(Learner::new(Parameters::random(seed))),
        "heuristic" => seated(Heuristic),
        "reference" => {
            seated::<Telemetry>(Witness::new(planner::bracket(objective, scenario, &|| true)?.witness))
        }
        _ => return Err(PolicyError::unknown(name, &SPECS)),
    })
}

/// The learner's policy at these parameters.
#[must_use]
pub fn learner(parameters: Parameters) -> Box<dyn Policy> {
    seated(Learner::new(parameters))
}
