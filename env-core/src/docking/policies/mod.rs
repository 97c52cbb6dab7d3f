//! Policies without a model, for docking.

mod pilot;
pub mod reflex;
mod simple;

use std::any::Any;

use self::pilot::Proportional;
use self::reflex::Parameters;
use self::simple::{Blind, Hold, Random, Witness};
use super::approach::Approach;
use super::planner;
use super::telemetry::Telemetry;
use crate::log::ActionLog;
use crate::policy::{Policy, PolicyError, PolicySpec};
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

/// A policy of docking acts on telemetry.
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
/// An unknown name, or (for the reference) a scenario whose start cannot be drawn.
pub fn by_name(name: &str, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError> {
    let seed = Seed::in_space(SeedSpace::User, seed);
    Ok(match name {
        "hold" => Box::new(Seat(Hold)),
        "random" => Box::new(Seat(Random::new(seed))),
        "blind" => Box::new(Seat(Blind)),
        "frozen" => by_law(Parameters::random(seed).approach()),
        "heuristic" => by_law(Approach::PILOT),
        "reference" => Box::new(Seat(Witness::new(planner::bracket(scenario)?.witness))),
        _ => {
            return Err(PolicyError::Unknown {
                name: name.to_owned(),
                known: SPECS.map(|spec| spec.name).join(", "),
            });
        }
    })
}

/// The policy that flies every deputy by this law.
#[must_use]
pub fn by_law(law: Approach) -> Box<dyn Policy> {
    Box::new(Seat(Proportional(law)))
}
