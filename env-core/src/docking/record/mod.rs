//! Episodes recorded elsewhere, replayed from their starts and actions.

pub mod format;
mod tally;

use serde::Deserialize;
use serde_json::Value;

use self::format::{RecordedAgent, RecordedEpisode, RecordedStep, Recording};
use self::tally::{Quantity, Tally};
use super::TASKS;
use super::constants::{COLLISION_DISTANCE_M, MAX_DEPUTIES, STATE};
use super::flight::{Ends, Flight, Stepped, Thrusts, observe};
use super::relative::separation;
use super::setup::{Setup, Start};
use crate::scenario::Recipe;
use crate::world::{Compared, RecordError};

/// The recording forms the delta-v reward from single-precision thrusts, in single precision: rewards with it in them
/// agree to the rounding of 0.0025, not better.
const SINGLE: f64 = 1e-8;
/// Observations are single precision on both sides, formed in another order: two roundings apart at most.
const ULPS: f64 = 2.0 * f32::EPSILON as f64;

/// Whether a file looks like a recording of this world.
#[must_use]
pub fn recognise(recording: &Value) -> bool {
    recording.pointer("/episodes/0/init_state").is_some_and(Value::is_object)
        && recording.pointer("/episodes/0/steps/0/agents").is_some_and(Value::is_object)
}

/// Replays every episode and compares it step by step, for the deputies that were stepped.
///
/// # Errors
/// A recording that is none.
pub fn compare_all(recording: &Value, tolerance: f64) -> Result<Compared, RecordError> {
    let recording = Recording::deserialize(recording)
        .map_err(|error| RecordError::Malformed(format!("it is not a recording: {error}")))?;
    let mut tally = Tally::new(tolerance);
    for (index, episode) in recording.episodes.iter().enumerate() {
        tally.episode = index;
        compare(episode, &mut tally).map_err(|reason| RecordError::Episode { episode: index, reason })?;
    }
    Ok(tally.compared(recording.episodes.len()))
}

/// One episode; the error says why it cannot be replayed.
fn compare(episode: &RecordedEpisode, tally: &mut Tally) -> Result<(), String> {
    let names: Vec<&str> = episode.init_state.keys().map(String::as_str).collect();
    let numbers = episode.numbers()?;
    let mut flight = restage(episode)?;
    tally.step = 1;
    for (i, name) in names.iter().enumerate() {
        if let Some(theirs) = episode.init_obs.get(*name) {
            compare_observation(&flight, i, theirs, tally);
        }
    }
    for (&number, step) in numbers.iter().zip(&episode.steps) {
        while flight.steps() as usize + 1 < number && !flight.done() {
            flight.fly([[0.0; 3]; MAX_DEPUTIES]);
        }
        tally.step = number;
        if flight.done() {
            tally.differ(format!("it ended at step {}, recorded going on", flight.steps()));
            return Ok(());
        }
        let mut thrusts: Thrusts = [[0.0; 3]; MAX_DEPUTIES];
        for (i, name) in names.iter().enumerate() {
            if let Some(agent) = step.agents.get(*name) {
                if !agent.action.iter().all(|axis| axis.is_finite()) {
                    return Err(format!("step {number}: the action of {name} is not finite"));
                }
                thrusts[i] = agent.action;
            }
        }
        let stepped = flight.fly(thrusts);
        tally.steps += 1;
        if !compare_step(&flight, &stepped, &names, step, tally) {
            return Ok(());
        }
    }
    for (i, name) in names.iter().enumerate() {
        if let Some(&theirs) = episode.returns.get(*name) {
            let allowed = tally.tolerance.max(SINGLE * episode.n_steps as f64);
            tally.number(Quantity::Return, flight.deputies()[i].earned, theirs, allowed, name);
        }
    }
    Ok(())
}

/// The recorded start, on the task with as many deputies.
fn restage(episode: &RecordedEpisode) -> Result<Flight, String> {
    let deputies = episode.init_state.len();
    if deputies == 0 || deputies > MAX_DEPUTIES {
        return Err(format!("{deputies} deputies; docking has 1 to {MAX_DEPUTIES}"));
    }
    let params = [("deputies", deputies as f64)];
    let recipe = Recipe::with_params(&TASKS[1], params.into_iter()).map_err(|error| error.to_string())?;
    let setup = Setup::read(&recipe).map_err(|error| error.to_string())?;
    let mut start = Start { deputies, states: [[0.0; STATE]; MAX_DEPUTIES] };
    for (state, recorded) in start.states.iter_mut().zip(episode.init_state.values()) {
        *state = *recorded;
    }
    Ok(Flight::new(setup, &start))
}

/// One step. No where the recording goes on by a rule that is not ours: there is nothing to compare after it.
fn compare_step(
    flight: &Flight,
    stepped: &Stepped,
    names: &[&str],
    step: &RecordedStep,
    tally: &mut Tally,
) -> bool {
    let parted = parted(flight, stepped, step);
    for (i, name) in names.iter().enumerate() {
        let Some(agent) = step.agents.get(*name) else {
            if stepped.live_before[i] {
                tally.differ(format!("{name} still flies, recorded as gone"));
            }
            continue;
        };
        if !stepped.live_before[i] {
            tally.differ(format!("{name} has left, recorded as flying"));
            continue;
        }
        if let Some(theirs) = step.state.get(*name) {
            for (&ours, &theirs) in flight.deputies()[i].state.iter().zip(theirs) {
                tally.number(Quantity::State, ours, theirs, tally.tolerance, name);
            }
        }
        compare_observation(flight, i, &agent.obs, tally);
        compare_reward(stepped, i, name, agent, tally);
        if parted.is_none() {
            compare_end(flight, i, name, agent, tally);
        }
    }
    match parted {
        Some(why) => {
            tally.documented.push(format!("episode {} step {}: {why}", tally.episode, tally.step));
            false
        }
        None => {
            if flight.done() != step.all_done {
                tally.differ(format!("done is {}, recorded {}", flight.done(), step.all_done));
            }
            true
        }
    }
}

/// Why the recording ends here and we do not, where that is one of the two differences that are meant.
fn parted(flight: &Flight, stepped: &Stepped, step: &RecordedStep) -> Option<&'static str> {
    let says = |rule: &str| step.agents.values().any(|agent| agent.done_info.iter().any(|name| name == rule));
    if says("EpisodeLengthDone") && !flight.done() {
        return Some(
            "the recording's environment cuts episodes off at its own horizon of 1000 s; here the task's 2000 s hold",
        );
    }
    let collided = flight.deputies().iter().any(|deputy| deputy.ends.collision);
    if says("CollisionDoneFunction") && !collided && !flight.done() {
        let left = |i: usize| stepped.live_before[i] && flight.deputies()[i].ends.any();
        let near = |i: usize, j: usize| {
            separation(&flight.deputies()[i].state, &flight.deputies()[j].state) < COLLISION_DISTANCE_M
        };
        let pairs = (0..flight.deputies().len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        if pairs.into_iter().any(|(i, j)| (left(i) || left(j)) && near(i, j)) {
            return Some(
                "the recording counts a deputy that leaves in this step as hit, in an order that is not defined; here a \
                 deputy that has left takes no further part",
            );
        }
    }
    None
}

fn compare_observation(flight: &Flight, i: usize, theirs: &[f64], tally: &mut Tally) {
    for (column, (ours, &theirs)) in observe(&flight.deputies()[i].state).into_iter().zip(theirs).enumerate()
    {
        let ours = f64::from(ours);
        // Near zero what counts is the rounding of the state, 1e-9 of a metre or less, not that of the number.
        let allowed = tally.tolerance.max(ULPS * ours.abs().max(theirs.abs()).max(0.01));
        tally.number(Quantity::Observation, ours, theirs, allowed, &format!("deputy {i}, column {column}"));
    }
}

fn compare_reward(stepped: &Stepped, i: usize, name: &str, agent: &RecordedAgent, tally: &mut Tally) {
    let (ours, theirs) = (&stepped.rewards[i], &agent.components);
    let (exact, single) = (tally.tolerance, tally.tolerance.max(SINGLE));
    for (quantity, ours, theirs, allowed) in [
        (Quantity::Distance, ours.distance, theirs.distance, exact),
        (Quantity::DeltaV, ours.delta_v, theirs.delta_v, single),
        (Quantity::Velocity, ours.velocity, theirs.velocity, exact),
        (Quantity::Success, ours.success, theirs.success, exact),
        (Quantity::Failure, ours.failure, theirs.failure, exact),
        (Quantity::Reward, ours.total(), agent.reward, single),
    ] {
        tally.number(quantity, ours, theirs, allowed, name);
    }
}

/// Done flag, the rules by which, and what they say.
fn compare_end(flight: &Flight, i: usize, name: &str, agent: &RecordedAgent, tally: &mut Tally) {
    let ends = flight.deputies()[i].ends;
    let all_docked = flight.done() && flight.deputies().iter().all(|deputy| deputy.ends.docked);
    let mut ours = rules(ends, all_docked);
    let mut theirs: Vec<(&str, Option<&str>)> = agent
        .done_info
        .iter()
        .map(|rule| (rule.as_str(), agent.status.get(rule).map(String::as_str)))
        .collect();
    ours.sort_unstable();
    theirs.sort_unstable();
    if ends.any() != agent.done {
        tally.differ(format!("{name} is done: {}, recorded {}", ends.any(), agent.done));
    } else if ours != theirs {
        tally.differ(format!("{name} ends by {ours:?}, recorded {theirs:?}"));
    }
}

/// The names that the original gives to its rules, and what they say of the deputy.
fn rules(ends: Ends, all_docked: bool) -> Vec<(&'static str, Option<&'static str>)> {
    [
        (ends.timeout, "TimeoutDoneFunction", Some("LOSE")),
        (ends.out_of_bounds, "MaxDistanceDoneFunction", Some("LOSE")),
        (ends.crash, "CrashDoneFunction", Some("LOSE")),
        (ends.docked, "SuccessfulDockingDoneFunction", Some("WIN")),
        (ends.saturated, "DockingVelocityLimitSaturationDone", Some("LOSE")),
        (ends.collision, "CollisionDoneFunction", None),
        (all_docked, "MultiagentSuccessDoneFunction", None),
    ]
    .into_iter()
    .filter(|(holds, ..)| *holds)
    .map(|(_, rule, says)| (rule, says))
    .collect()
}
