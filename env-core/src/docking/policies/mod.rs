//! Policies without a model, for docking.

mod pilot;
pub mod reflex;
mod simple;

use self::pilot::Proportional;
use self::reflex::Parameters;
use self::simple::{Blind, Random};
use super::approach::Approach;
use super::planner;
use super::telemetry::Telemetry;
use crate::policy::{Hold, Policy, PolicyError, PolicySpec, Witness, seated};
use crate::scenario::Scenario;
use crate::seed::{Seed, SeedSpace};

/// The policies, in the order people should read them.
pub static SPECS: [PolicySpec; 6] = [
    PolicySpec { name: "hold", about: "does nothing", chance: false },
    PolicySpec { name: "random", about: "thrusts at random on every axis in every step", chance: true },
    PolicySpec {
        name: "blind",
        about: "thrusts inwards along x for the first 10 s, whatever there is",
        chance: false,
    },
    PolicySpec { name: "frozen", about: "the trainable reflex at random numbers, untrained", chance: true },
    PolicySpec {
        name: "heuristic",
        about: "flies at the chief at 0.85 of the speed limit, and at 0.1 m/s within 3 m",
        chance: false,
    },
    PolicySpec { name: "reference", about: "the planner", chance: false },
];

/// A policy by name.
///
/// # Errors
/// An unknown name, or (for the reference) a scenario whose start cannot be drawn.
pub fn by_name(name: &str, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError> {
    let seed = Seed::in_space(SeedSpace::User, seed);
    Ok(match name {
        "hold" => seated::<Telemetry>(Hold),
        "random" => seated(Random::new(seed)),
        "blind" => seated(Blind),
        "frozen" => by_law(Parameters::random(seed).approach()),
        "heuristic" => by_law(Approach::PILOT),
        "reference" => seated::<Telemetry>(Witness::new(planner::bracket(scenario)?.witness)),
        _ => return Err(PolicyError::unknown(name, &SPECS)),
    })
}

/// The policy that flies every deputy by this law.
#[must_use]
pub fn by_law(law: Approach) -> Box<dyn Policy> {
    seated(Proportional(law))
}
