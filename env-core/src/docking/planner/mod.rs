//! The reference planner: computes the bracket of a scenario.
//!
//! Deputies do not affect each other until they collide, so each is planned by itself. The planner tries the approach law
//! with a list of parameters: from just below the speed limit to well above it if time is too short to keep the limit.
//! Then all deputies are simulated together. If two collide, one of them takes its next best law, until none do. The
//! result is a lower bound on the best score.

pub(super) mod solo_plan;

use self::solo_plan::SoloPlan;
use super::constants::MAX_DEPUTIES;
use super::event::DockingEvent;
use super::setup::{DeputyStarts, DockingSetup};
use super::simulation::{DockingSim, Thrusts};
use crate::bracket::{Bracket, EpisodeOutcome};
use crate::episode_rng::SeededRng;
use crate::error::ScenarioError;
use crate::log::{ActionLog, Precision};
use crate::task::Scenario;

/// Version of the planner. A change that alters any bracket increments it.
pub const PLANNER_VERSION: u32 = 1;

/// Largest number of joint simulations to keep deputies apart.
const MAX_JOINT_ATTEMPTS: usize = 24;

/// Computes the bracket. The panel is the hold plan alone, and its score is the floor.
///
/// # Errors
/// Returns [`ScenarioError::Unfair`] if the start cannot be sampled.
pub fn bracket(scenario: &Scenario) -> Result<Bracket, ScenarioError> {
    let setup = DockingSetup::read(scenario.recipe())?;
    let start = setup.sample_starts(&mut SeededRng::new(scenario.seed()))?;
    let mut sim = DockingSim::new(setup, &start);
    while !sim.is_done() {
        sim.apply_thrusts([[0.0; 3]; MAX_DEPUTIES]);
    }
    let hold = sim.outcome();
    let planned = plan_jointly(&mut sim, &start);
    let (reference, reference_plan) = match planned {
        Some(best) if is_better(&best.outcome, &hold) => (best.outcome, best.log),
        _ => (hold, hold_log(hold.steps)),
    };
    Ok(Bracket {
        planner_version: PLANNER_VERSION,
        panel: vec![hold],
        floor: hold.score,
        reference,
        reference_plan,
    })
}

/// Result of a simulation of all deputies together.
struct JointPlan {
    outcome: EpisodeOutcome,
    log: ActionLog,
    /// The first pair of deputies that collided, if any.
    collided: Option<[usize; 2]>,
}

/// True if `a` docks more deputies than `b`, or as many with a higher score.
fn is_better(a: &EpisodeOutcome, b: &EpisodeOutcome) -> bool {
    let docked = |outcome: &EpisodeOutcome| outcome.goal.unwrap_or(0.0);
    docked(a) > docked(b) || (docked(a) == docked(b) && a.score > b.score)
}

/// Searches for the best laws of all deputies together.
fn plan_jointly(sim: &mut DockingSim, start: &DeputyStarts) -> Option<JointPlan> {
    let setup = *sim.setup();
    let states = &start.states[..start.deputies];
    let ranked: Vec<Vec<SoloPlan>> = states.iter().map(|&state| SoloPlan::ranked(&setup, state)).collect();
    let mut choice = [0; MAX_DEPUTIES];
    let mut best: Option<JointPlan> = None;
    for _ in 0..MAX_JOINT_ATTEMPTS {
        let plan = simulate_jointly(sim, start, |i| &ranked[i][choice[i]]);
        let collided = plan.collided;
        if best.as_ref().is_none_or(|best| is_better(&plan.outcome, &best.outcome)) {
            best = Some(plan);
        }
        let Some(pair) = collided else { break };
        // Of the two, the deputy that loses less by its next law takes it.
        let loss = |i: usize| {
            let next = ranked[i].get(choice[i] + 1).filter(|solo| solo.docked)?;
            Some(ranked[i][choice[i]].reward - next.reward)
        };
        let give_way =
            pair.into_iter().filter_map(|i| loss(i).map(|loss| (i, loss))).min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((i, _)) = give_way else { break };
        choice[i] += 1;
    }
    best
}

/// Simulates all deputies with their laws.
fn simulate_jointly<'a>(
    sim: &mut DockingSim,
    start: &DeputyStarts,
    law: impl Fn(usize) -> &'a SoloPlan,
) -> JointPlan {
    sim.reset(start);
    let bound = sim.setup().thrust_bound;
    let mut log = ActionLog::new(3, Precision::F64);
    while !sim.is_done() {
        let mut thrusts: Thrusts = [[0.0; 3]; MAX_DEPUTIES];
        for (i, deputy) in sim.deputies().iter().enumerate() {
            if deputy.is_active() {
                thrusts[i] = law(i).law.thrust(&deputy.state, bound);
                log.push_entry(i as u32, &thrusts[i]);
            }
        }
        log.end_step();
        sim.apply_thrusts(thrusts);
    }
    let collided = sim.events().iter().find_map(|event| match event {
        DockingEvent::Collided { first, second, .. } => Some([*first as usize, *second as usize]),
        _ => None,
    });
    JointPlan { outcome: sim.outcome(), log, collided }
}

fn hold_log(steps: u32) -> ActionLog {
    let mut log = ActionLog::new(3, Precision::F64);
    (0..steps).for_each(|_| log.end_step());
    log
}
