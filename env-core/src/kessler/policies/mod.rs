//! Built-in policies of kessler that use no model. Start reading at [`KESSLER_POLICIES`].

mod common;
mod debris_forecast;
mod heuristic;
mod open_loop;
mod reflex_parameters;
mod reflex_policy;

use self::heuristic::HeuristicPolicy;
use self::open_loop::{BlindKickPolicy, RandomBurnPolicy};
pub use self::reflex_parameters::{KESSLER_REFLEX_LEN, KesslerReflexParameters};
use self::reflex_policy::KesslerReflexPolicy;
use super::planner;
use super::reward::Objective;
use super::telemetry::KesslerTelemetry;
use crate::policy::{
    HoldPolicy, PLANNER_POLICY, PlanPolicy, Policy, PolicyError, PolicySpec, erase_type, unknown_policy,
};
use crate::reflex::Reflex;
use crate::seed::{Seed, SeedSpace};
use crate::task::Scenario;

/// All policies, in the order in which the docs list them.
pub static KESSLER_POLICIES: [PolicySpec; 6] = [
    PolicySpec { name: "hold", description: "does nothing", stochastic: false },
    PolicySpec {
        name: "random",
        description: "burns at random on every axis in every step",
        stochastic: true,
    },
    PolicySpec {
        name: "blind",
        description: "one fixed radial kick of 0.2 LU/TU at the first step",
        stochastic: false,
    },
    PolicySpec {
        name: "frozen",
        description: "the trainable reflex at random numbers, untrained",
        stochastic: true,
    },
    PolicySpec { name: "heuristic", description: "looks ahead and dodges what it sees", stochastic: false },
    PolicySpec { name: PLANNER_POLICY, description: "the planner, with hindsight", stochastic: false },
];

/// The reflex of kessler.
pub const KESSLER_REFLEX: Reflex = Reflex {
    names: &KesslerReflexParameters::NAMES,
    policy: |numbers| reflex_policy(KesslerReflexParameters::from_numbers(numbers)),
    meaning: |numbers| KesslerReflexParameters::from_numbers(numbers).meanings().to_vec(),
};

/// Creates a policy by its name.
///
/// # Errors
/// Returns [`PolicyError::Unknown`] for an unknown name, and [`PolicyError::Scenario`] if the reference
/// policy is created for a scenario whose start is not fair.
pub fn by_name(
    name: &str,
    objective: Objective,
    scenario: &Scenario,
    seed: u64,
) -> Result<Box<dyn Policy>, PolicyError> {
    let seed = Seed::in_space(SeedSpace::User, seed);
    Ok(match name {
        "hold" => erase_type::<KesslerTelemetry>(HoldPolicy),
        "random" => erase_type(RandomBurnPolicy::new(seed)),
        "blind" => erase_type(BlindKickPolicy::new()),
        "frozen" => reflex_policy(KesslerReflexParameters::random(seed)),
        "heuristic" => erase_type(HeuristicPolicy),
        PLANNER_POLICY => {
            let bracket = planner::bracket(objective, scenario, &|| true)?;
            erase_type::<KesslerTelemetry>(PlanPolicy::new(bracket.reference_plan))
        }
        _ => return Err(unknown_policy(name, &KESSLER_POLICIES)),
    })
}

/// Creates the reflex policy with these parameters.
#[must_use]
pub fn reflex_policy(parameters: KesslerReflexParameters) -> Box<dyn Policy> {
    erase_type(KesslerReflexPolicy::new(parameters))
}
