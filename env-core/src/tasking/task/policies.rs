//! Built-in policies of tasking. Each gives actions to satellites that need one; `hold` gives none.

use super::blind::{BLIND_CYCLE, CyclePolicy};
use super::bracket;
use super::rule::TaskingRule;
use super::telemetry::TaskingTelemetry;
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::log::ActionLog;
use crate::policy::{
    HoldPolicy, PLANNER_POLICY, PlanPolicy, Policy, PolicyError, PolicySpec, TypedPolicy, erase_type,
    unknown_policy,
};
use crate::reflex::Reflex;
use crate::seed::{Seed, SeedSpace};
use crate::task::Scenario;

/// The policies in the order of presentation.
pub(super) static TASKING_POLICIES: [PolicySpec; 6] = [
    PolicySpec { name: "hold", description: "gives no action: satellites drift", stochastic: false },
    PolicySpec {
        name: "random",
        description: "gives a random action whenever one is needed",
        stochastic: true,
    },
    PolicySpec {
        name: "blind",
        description: "scans, or images the next target, and charges in turn, without looking",
        stochastic: false,
    },
    PolicySpec {
        name: "frozen",
        description: "the trainable rule at random parameters, untrained",
        stochastic: true,
    },
    PolicySpec {
        name: "heuristic",
        description: "charges in sunlight below 40 %, or below 20 % if the next eclipse is far, desaturates above 15 % of the wheels' limit, downlinks above 30 % of the \
                      storage in view of a station, and else scans or images the most valuable target",
        stochastic: false,
    },
    PolicySpec { name: PLANNER_POLICY, description: "the planner", stochastic: false },
];

/// The reflex of tasking.
pub(super) const TASKING_REFLEX: Reflex = Reflex {
    names: &TaskingRule::NAMES,
    policy: |numbers| rule_policy(TaskingRule::from_numbers(numbers)),
    meaning: |numbers| TaskingRule::from_numbers(numbers).meanings(),
};

/// Creates a policy by name.
///
/// # Errors
/// Returns an error if the name is unknown or, for `reference`, if the scenario cannot start.
pub(super) fn create_policy(
    name: &str,
    scenario: &Scenario,
    seed: u64,
) -> Result<Box<dyn Policy>, PolicyError> {
    let seed = Seed::in_space(SeedSpace::User, seed);
    Ok(match name {
        "hold" => erase_type::<TaskingTelemetry>(HoldPolicy),
        "random" => erase_type(RandomPolicy(SeededRng::new(seed))),
        "blind" => erase_type(CyclePolicy::new(BLIND_CYCLE)),
        "frozen" => rule_policy(TaskingRule::random(seed)),
        "heuristic" => rule_policy(TaskingRule::HEURISTIC),
        PLANNER_POLICY => {
            erase_type::<TaskingTelemetry>(PlanPolicy::new(bracket::bracket(scenario)?.reference_plan))
        }
        _ => return Err(unknown_policy(name, &TASKING_POLICIES)),
    })
}

/// Creates the policy that follows a rule.
fn rule_policy(rule: TaskingRule) -> Box<dyn Policy> {
    erase_type(RulePolicy(rule))
}

/// Gives a uniform random action to every satellite that needs one.
struct RandomPolicy(SeededRng);

impl TypedPolicy<TaskingTelemetry> for RandomPolicy {
    fn append_actions(&mut self, observation: &TaskingTelemetry, log: &mut ActionLog) {
        let count = observation.actions.len() as f64;
        for satellite in &observation.satellites {
            // One draw for each satellite, so that none depends on what the others do.
            let draw = self.0.uniform(RngStream::Policy);
            if satellite.needs_action {
                log.push_entry(satellite.id, &[libm::floor(draw * count).min(count - 1.0)]);
            }
        }
    }
}

impl TypedPolicy<TaskingTelemetry> for CyclePolicy {
    fn append_actions(&mut self, observation: &TaskingTelemetry, log: &mut ActionLog) {
        for satellite in observation.satellites.iter().filter(|satellite| satellite.needs_action) {
            let action = self.next(satellite.id as usize, observation.actions.len());
            log.push_entry(satellite.id, &[action as f64]);
        }
    }
}

/// Follows a rule for every satellite.
struct RulePolicy(TaskingRule);

impl TypedPolicy<TaskingTelemetry> for RulePolicy {
    fn append_actions(&mut self, observation: &TaskingTelemetry, log: &mut ActionLog) {
        for satellite in observation.satellites.iter().filter(|satellite| satellite.needs_action) {
            let action = self.0.choose(satellite).index(observation.actions.len());
            log.push_entry(satellite.id, &[action as f64]);
        }
    }
}
