//! The reference planner: panel, floor, reference and witness of a scenario, without the agent.
//!
//! Deputies do not feel each other until they touch, so each is planned by itself: the approach law at a list of
//! numbers, from just below the speed limit to well beyond it where time is too short to keep it. Then all are flown
//! together; where two collide, one of them takes its next best law, until nobody does. What it earns is a lower bound
//! on the best, never the best.

pub(super) mod solo;

use self::solo::{Solo, laws};
use super::constants::MAX_DEPUTIES;
use super::event::Event;
use super::flight::{Flight, Thrusts};
use super::setup::{Setup, Start};
use crate::bracket::{Bracket, Flown};
use crate::chance::Seeded;
use crate::error::ScenarioError;
use crate::log::{ActionLog, Precision};
use crate::scenario::Scenario;

/// Version of the planner: any change that moves a bracket raises it.
pub const VERSION: u32 = 1;

/// Joint flights tried at most to keep deputies apart.
const TRIES: usize = 24;

/// Panel, floor, reference and witness. The panel is hold alone, and its score the floor.
///
/// # Errors
/// A scenario whose start cannot be drawn.
pub fn bracket(scenario: &Scenario) -> Result<Bracket, ScenarioError> {
    let setup = Setup::read(scenario.recipe())?;
    let start = setup.start(&mut Seeded::new(scenario.seed()))?;
    let mut flight = Flight::new(setup, &start);
    while !flight.done() {
        flight.fly([[0.0; 3]; MAX_DEPUTIES]);
    }
    let hold = flight.flown();
    let planned = plan(&mut flight, &setup, &start);
    let (reference, witness) = match planned {
        Some(best) if better(&best.flown, &hold) => (best.flown, best.log),
        _ => (hold, holding(hold.steps)),
    };
    Ok(Bracket { planner: VERSION, panel: vec![hold], floor: hold.score, reference, witness })
}

/// A joint flight and its log.
struct Joint {
    flown: Flown,
    log: ActionLog,
}

/// More docked is better; then the score decides.
fn better(a: &Flown, b: &Flown) -> bool {
    let docked = |flown: &Flown| flown.goal.unwrap_or(0.0);
    docked(a) > docked(b) || (docked(a) == docked(b) && a.score > b.score)
}

/// The best joint flight found.
fn plan(flight: &mut Flight, setup: &Setup, start: &Start) -> Option<Joint> {
    let laws = laws(setup.thrust_bound);
    let ranked: Vec<Vec<Solo>> = start.states[..start.deputies]
        .iter()
        .map(|state| {
            let mut solos: Vec<Solo> = laws.iter().map(|&law| Solo::fly(setup, *state, law)).collect();
            solos.sort_by(Solo::best_first);
            solos
        })
        .collect();
    let mut choice = [0; MAX_DEPUTIES];
    let mut best: Option<Joint> = None;
    for _ in 0..TRIES {
        let (flown, log, pair) = together(flight, start, |i| &ranked[i][choice[i]]);
        if best.as_ref().is_none_or(|best| better(&flown, &best.flown)) {
            best = Some(Joint { flown, log });
        }
        let Some(pair) = pair else { break };
        // Of the two, the one that loses less by its next law gives way.
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

/// All deputies flown together by their laws: how it went, the log, and the pair that collided, if one did.
fn together<'a>(
    flight: &mut Flight,
    start: &Start,
    law: impl Fn(usize) -> &'a Solo,
) -> (Flown, ActionLog, Option<[usize; 2]>) {
    flight.restart(start);
    let bound = flight.setup().thrust_bound;
    let mut log = ActionLog::new(3, Precision::F64);
    while !flight.done() {
        let mut thrusts: Thrusts = [[0.0; 3]; MAX_DEPUTIES];
        for (i, deputy) in flight.deputies().iter().enumerate() {
            if deputy.flies() {
                thrusts[i] = law(i).law.thrust(&deputy.state, bound);
                log.act(i as u32, &thrusts[i]);
            }
        }
        log.end_step();
        flight.fly(thrusts);
    }
    let pair = flight.events().iter().find_map(|event| match event {
        Event::Collided { first, second, .. } => Some([*first as usize, *second as usize]),
        _ => None,
    });
    (flight.flown(), log, pair)
}

fn holding(steps: u32) -> ActionLog {
    let mut log = ActionLog::new(3, Precision::F64);
    (0..steps).for_each(|_| log.end_step());
    log
}
