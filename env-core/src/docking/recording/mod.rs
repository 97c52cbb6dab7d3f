//! Replays episodes that safe-autonomy-sims recorded, from their starts and actions, and compares the results.

pub mod format;

use serde::Deserialize;
use serde_json::Value;

use self::format::{DockingRecording, RecordedAgent, RecordedEpisode, RecordedStep};
use super::DOCKING_TASKS;
use super::constants::{COLLISION_DISTANCE_M, MAX_DEPUTIES};
use super::end_conditions::EndConditions;
use super::relative_motion::separation;
use super::setup::{DeputyStarts, DockingSetup};
use super::simulation::{DockingSim, DockingStep, Thrusts, observe_deputy};
use crate::difference_tally::DifferenceTally;
use crate::task::Recipe;
use crate::world::{ComparisonError, RecordingComparison};

/// Tolerance of rewards that contain the delta-v reward. The original computes it in single precision from single-precision
/// thrusts, so these rewards agree only to the rounding of 0.0025.
const SINGLE_PRECISION_TOLERANCE: f64 = 1e-8;
/// Relative tolerance of observations. Both sides compute them in single precision in different order, so they differ by at
/// most two roundings.
const OBSERVATION_TOLERANCE: f64 = 2.0 * f32::EPSILON as f64;

/// Names of the compared quantities.
const QUANTITIES: [&str; 9] = [
    "state",
    "observation",
    "reward_distance",
    "reward_delta_v",
    "reward_velocity",
    "reward_success",
    "reward_failure",
    "reward",
    "return",
];

/// True if a file looks like a recording of this world.
#[must_use]
pub fn is_recording(recording: &Value) -> bool {
    recording.pointer("/episodes/0/init_state").is_some_and(Value::is_object)
        && recording.pointer("/episodes/0/steps/0/agents").is_some_and(Value::is_object)
}

/// Replays every episode and compares it step by step, for the deputies that were active.
///
/// # Errors
/// Returns an error if the file is not a recording or an episode cannot be replayed.
pub fn compare_recording(recording: &Value, tolerance: f64) -> Result<RecordingComparison, ComparisonError> {
    let recording = DockingRecording::deserialize(recording)
        .map_err(|error| ComparisonError::Malformed(format!("it is not a recording: {error}")))?;
    let mut tally = DifferenceTally::new(&QUANTITIES, Some("done"), tolerance);
    for (index, episode) in recording.episodes.iter().enumerate() {
        tally.episode = index;
        compare_episode(episode, &mut tally)
            .map_err(|reason| ComparisonError::Episode { episode: index, reason })?;
    }
    Ok(tally.into_comparison(recording.episodes.len()))
}

/// Compares one episode; the error says why it cannot be replayed.
fn compare_episode(episode: &RecordedEpisode, tally: &mut DifferenceTally) -> Result<(), String> {
    let names: Vec<&str> = episode.init_state.keys().map(String::as_str).collect();
    let numbers = episode.step_numbers()?;
    let mut sim = restore_start(episode)?;
    tally.step = 1;
    for (i, name) in names.iter().enumerate() {
        if let Some(theirs) = episode.init_obs.get(*name) {
            compare_observation(&sim, i, theirs, tally);
        }
    }
    for (&number, step) in numbers.iter().zip(&episode.steps) {
        while sim.steps() as usize + 1 < number && !sim.is_done() {
            sim.apply_thrusts([[0.0; 3]; MAX_DEPUTIES]);
        }
        tally.step = number;
        if sim.is_done() {
            tally.add_mismatch(format!(
                "the replay ended at step {}, but the recording continues",
                sim.steps()
            ));
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
        let result = sim.apply_thrusts(thrusts);
        tally.steps += 1;
        if !compare_step(&sim, &result, &names, step, tally) {
            return Ok(());
        }
    }
    for (i, name) in names.iter().enumerate() {
        if let Some(&theirs) = episode.returns.get(*name) {
            let allowed = tally.tolerance.max(SINGLE_PRECISION_TOLERANCE * episode.n_steps as f64);
            tally.compare_numbers(
                "return",
                sim.deputies()[i].total_reward,
                theirs,
                allowed,
                format_args!("return of {name}"),
            );
        }
    }
    Ok(())
}

/// Creates a simulation at the recorded start, with as many deputies.
fn restore_start(episode: &RecordedEpisode) -> Result<DockingSim, String> {
    let deputies = episode.init_state.len();
    if deputies == 0 || deputies > MAX_DEPUTIES {
        return Err(format!("{deputies} deputies; docking has 1 to {MAX_DEPUTIES}"));
    }
    let params = [("deputies", deputies as f64)];
    let recipe =
        Recipe::with_params(&DOCKING_TASKS[1], params.into_iter()).map_err(|error| error.to_string())?;
    let setup = DockingSetup::read(&recipe).map_err(|error| error.to_string())?;
    let mut start = DeputyStarts::at_chief(deputies, setup.time_limit);
    for (state, recorded) in start.states.iter_mut().zip(episode.init_state.values()) {
        *state = *recorded;
    }
    Ok(DockingSim::new(setup, &start))
}

/// Compares one step. Returns false if the recording then follows a rule that differs on purpose, which ends the
/// comparison.
fn compare_step(
    sim: &DockingSim,
    result: &DockingStep,
    names: &[&str],
    step: &RecordedStep,
    tally: &mut DifferenceTally,
) -> bool {
    let difference = intended_difference(sim, result, step);
    for (i, name) in names.iter().enumerate() {
        let Some(agent) = step.agents.get(*name) else {
            if result.active_before[i] {
                tally.add_mismatch(format!("{name} still flies, recorded as gone"));
            }
            continue;
        };
        if !result.active_before[i] {
            tally.add_mismatch(format!("{name} has left, recorded as flying"));
            continue;
        }
        if let Some(theirs) = step.state.get(*name) {
            for (&ours, &theirs) in sim.deputies()[i].state.iter().zip(theirs) {
                let what = format_args!("state of {name}");
                tally.compare_numbers("state", ours, theirs, tally.tolerance, what);
            }
        }
        compare_observation(sim, i, &agent.obs, tally);
        compare_reward(result, i, name, agent, tally);
        if difference.is_none() {
            compare_end_conditions(sim, i, name, agent, tally);
        }
    }
    match difference {
        Some(why) => {
            tally.documented.push(format!("episode {} step {}: {why}", tally.episode, tally.step));
            false
        }
        None => {
            tally.compare_outcomes(&sim.is_done(), &step.all_done, format_args!("done"));
            true
        }
    }
}

/// The reason why the recording ends here and our episode does not, if it is one of two intended differences.
fn intended_difference(sim: &DockingSim, result: &DockingStep, step: &RecordedStep) -> Option<&'static str> {
    let says = |rule: &str| step.agents.values().any(|agent| agent.done_info.iter().any(|name| name == rule));
    if says("EpisodeLengthDone") && !sim.is_done() {
        return Some(
            "the recording environment truncates episodes at its own horizon of 1000 s; here the task's 2000 s apply",
        );
    }
    let collided = sim.deputies().iter().any(|deputy| deputy.end_conditions.collision);
    if says("CollisionDoneFunction") && !collided && !sim.is_done() {
        let left = |i: usize| result.active_before[i] && sim.deputies()[i].end_conditions.any();
        let near = |i: usize, j: usize| {
            separation(&sim.deputies()[i].state, &sim.deputies()[j].state) < COLLISION_DISTANCE_M
        };
        let pairs = (0..sim.deputies().len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        if pairs.into_iter().any(|(i, j)| (left(i) || left(j)) && near(i, j)) {
            return Some(
                "the recording counts a deputy that leaves in this step as hit, in an undefined order; here a deputy that has \
                 left cannot collide",
            );
        }
    }
    None
}

fn compare_observation(sim: &DockingSim, i: usize, theirs: &[f64], tally: &mut DifferenceTally) {
    for (column, (ours, &theirs)) in
        observe_deputy(&sim.deputies()[i].state).into_iter().zip(theirs).enumerate()
    {
        let ours = f64::from(ours);
        // Near zero the rounding of the state dominates, 1e-9 m or less, not that of the value.
        let allowed = tally.tolerance.max(OBSERVATION_TOLERANCE * ours.abs().max(theirs.abs()).max(0.01));
        let what = format_args!("observation of deputy {i}, column {column}");
        tally.compare_numbers("observation", ours, theirs, allowed, what);
    }
}

fn compare_reward(
    result: &DockingStep,
    i: usize,
    name: &str,
    agent: &RecordedAgent,
    tally: &mut DifferenceTally,
) {
    let (ours, theirs) = (&result.rewards[i], &agent.components);
    let (exact, single) = (tally.tolerance, tally.tolerance.max(SINGLE_PRECISION_TOLERANCE));
    for (quantity, ours, theirs, allowed) in [
        ("reward_distance", ours.distance, theirs.distance, exact),
        ("reward_delta_v", ours.delta_v, theirs.delta_v, single),
        ("reward_velocity", ours.velocity, theirs.velocity, exact),
        ("reward_success", ours.success, theirs.success, exact),
        ("reward_failure", ours.failure, theirs.failure, exact),
        ("reward", ours.total(), agent.reward, single),
    ] {
        tally.compare_numbers(quantity, ours, theirs, allowed, format_args!("{quantity} of {name}"));
    }
}

/// Compares the done flag, the rules by which the deputy left, and their verdicts.
fn compare_end_conditions(
    sim: &DockingSim,
    i: usize,
    name: &str,
    agent: &RecordedAgent,
    tally: &mut DifferenceTally,
) {
    let ends = sim.deputies()[i].end_conditions;
    let all_docked = sim.is_done() && sim.deputies().iter().all(|deputy| deputy.end_conditions.docked);
    let mut ours = original_rules(ends, all_docked);
    let mut theirs: Vec<(&str, Option<&str>)> = agent
        .done_info
        .iter()
        .map(|rule| (rule.as_str(), agent.status.get(rule).map(String::as_str)))
        .collect();
    ours.sort_unstable();
    theirs.sort_unstable();
    tally.compare_outcomes(&ends.any(), &agent.done, format_args!("{name} is done"));
    tally.compare_outcomes(&ours, &theirs, format_args!("ends of {name}"));
}

/// The original's names of the rules by which a deputy left, and their verdicts.
fn original_rules(ends: EndConditions, all_docked: bool) -> Vec<(&'static str, Option<&'static str>)> {
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
