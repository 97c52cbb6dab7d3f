//! Policies without a model, for kessler.

mod heuristic;
pub mod learner;
mod simple;

use std::any::Any;

use self::heuristic::Heuristic;
use self::learner::{Learner, Parameters};
use self::simple::{Blind, Hold, Random, Witness};
use super::planner;
use super::reward::Objective;
use super::telemetry::Telemetry;
use crate::log::ActionLog;
use crate::policy::{Policy, PolicyError, PolicySpec};
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

/// A policy of kessler acts on telemetry.
trait Pilot: Send {
    fn fly(&mut self, seen: &Telemetry, log: &mut ActionLog);
}

struct Seat<P>(P);

impl<P: Pilot> Policy for Seat<P> {
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog) {
        // An observation of another world says nothing to these policies: they hold.
        if let Some(seen) = observation.downcast_ref::<Telemetry>() {
            self.0.fly(seen, log);
        }
        log.end_step();
    }
}

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
        "hold" => Box::new(Seat(Hold)),
        "random" => Box::new(Seat(Random::new(seed))),
        "blind" => Box::new(Seat(Blind::new())),
        "frozen" => Box::new(Seat(Learner::new(Parameters::random(seed)))),
        "heuristic" => Box::new(Seat(Heuristic)),
        "reference" => Box::new(Seat(Witness::new(planner::bracket(objective, scenario, &|| true)?.witness))),
        _ => {
            return Err(PolicyError::Unknown {
                name: name.to_owned(),
                known: SPECS.map(|spec| spec.name).join(", "),
            });
        }
    })
}

/// The learner's policy at these parameters.
#[must_use]
pub fn learner(parameters: Parameters) -> Box<dyn Policy> {
    Box::new(Seat(Learner::new(parameters)))
}
