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
use crate::policy::{Policy, PolicyError};
use crate::scenario::Scenario;
use crate::seed::Seed;

/// The names, in the order people should read them.
pub const NAMES: [&str; 6] = ["hold", "random", "blind", "frozen", "heuristic", "reference"];

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
        "reference" => Box::new(Seat(Witness::new(planner::bracket(objective, scenario)?.witness))),
        _ => {
            return Err(PolicyError::Unknown { name: name.to_owned(), known: NAMES.join(", ") });
        }
    })
}

/// The learner's policy at these parameters.
#[must_use]
pub fn learner(parameters: Parameters) -> Box<dyn Policy> {
    Box::new(Seat(Learner::new(parameters)))
}
