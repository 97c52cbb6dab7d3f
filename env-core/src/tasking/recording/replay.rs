//! Replay of a recorded episode, step by step.

use serde_json::Value;

use super::compare::{BeforeStep, StepComparison, compare_initial};
use super::read::{ReadResult, list_of, member, number_of, satellite_names, text_of};
use super::reference::{is_older_recording, to_current_format};
use super::setup::read_setup;
use super::tolerances::{self, QUANTITIES, TIME_S};
use super::totals::{Totals, compare_sampled_light, compare_sky, compare_stations};
use super::trace::compare_trace;
use super::windows::{compare_opportunities, take_chosen};
use crate::difference_tally::DifferenceTally;
use crate::tasking::orbit::GravityModel;
use crate::tasking::simulation::{AgentAction, TaskingSim};
use crate::tasking::tick::dispatch::InstructionSet;
use crate::world::{ComparisonError, RecordingComparison};

/// True if a value is a recording of BSK-RL.
#[must_use]
pub fn is_recording(recording: &Value) -> bool {
    recording.get("format").and_then(Value::as_str) == Some("bsk-rl-recording")
        || is_older_recording(recording)
}

/// Replays a recording and compares it with the built-in tolerance of each quantity, or with `tolerance` where that is larger.
///
/// # Errors
/// Returns an error if the recording cannot be read or replayed.
pub fn compare_recording(recording: &Value, tolerance: f64) -> Result<RecordingComparison, ComparisonError> {
    compare_with_gravity(recording, GravityModel::Ggm10, tolerance)
}

/// Replays a recording under a gravity model.
///
/// # Errors
/// Returns an error if the recording cannot be read or replayed.
pub fn compare_with_gravity(
    recording: &Value,
    gravity: GravityModel,
    tolerance: f64,
) -> Result<RecordingComparison, ComparisonError> {
    let mut tally = DifferenceTally::new(&QUANTITIES, Some("outcome"), tolerance);
    let current = to_current_format(recording).map_err(ComparisonError::Malformed)?;
    let setup = read_setup(&current, gravity).map_err(ComparisonError::Malformed)?;
    let failed = |reason: String| ComparisonError::Episode { episode: 0, reason };
    let mut sim = TaskingSim::new(setup).map_err(|error| failed(error.to_string()))?;
    if recording.get("trace").is_some() || recording.get("note").is_some() || recording.get("steps").is_none()
    {
        compare_trace(recording, &current, &mut sim.clone(), &mut tally).map_err(failed)?;
    }
    replay_steps(&current, &mut sim, &mut tally).map_err(failed)?;
    Ok(tally.into_comparison(1))
}

/// Replays all steps of a recording of the current format.
fn replay_steps(recording: &Value, sim: &mut TaskingSim, tally: &mut DifferenceTally) -> ReadResult<()> {
    let names = satellite_names(recording)?;
    let steps = list_of(recording, "steps")?;
    let env = member(recording, "env")?;
    let observes_idle_only = env["generate_obs_retasking_only"].as_bool().unwrap_or(false);
    let tick_s = number_of(env, "sim_rate")?;
    let pays_resources =
        list_of(env, "rewarders")?.iter().any(|rewarder| rewarder["type"] == "ResourceReward");
    let reward_tolerance = if pays_resources { tolerances::RESOURCE_REWARD } else { tolerances::REWARD };
    compare_sky(&recording["initial"], sim, tally)?;
    compare_stations(&recording["station_positions"], sim, tally)?;
    compare_initial(recording, &names, sim, tick_s, tally)?;
    sim.keep_journal();
    let mut totals = Totals::default();
    for (index, step) in steps.iter().enumerate() {
        tally.step = index + 1;
        let actions = read_actions(member(step, "actions")?, &names, sim)?;
        let before = BeforeStep::of(sim);
        let result = sim
            .step(&actions, InstructionSet::detect())
            .map_err(|error| format!("step {}: {error}", index + 1))?;
        tally.steps += 1;
        totals.add(&result);
        let end = number_of(step, "t_end")?;
        tally.compare_numbers("step_end", sim.time_s(), end, TIME_S, format_args!("end of the step"));
        if (sim.time_s() - end).abs() > TIME_S {
            tally.add_mismatch(format!("step {} ends at another time: no later step is compared", index + 1));
            return Ok(());
        }
        let comparison = StepComparison {
            step,
            names: &names,
            before: &before,
            result: &result,
            chosen: &take_chosen(sim),
            observes_idle_only,
            reward_tolerance,
            tick_s,
        };
        comparison.run(sim, tally)?;
    }
    totals.compare(&recording["final"], &names, sim, reward_tolerance, tally)?;
    compare_opportunities(recording, &names, sim, tally)?;
    compare_sampled_light(&recording["eclipse_sampled"], &names[0], sim, tally)
}

/// Actions of all satellites in a step.
fn read_actions(actions: &Value, names: &[String], sim: &TaskingSim) -> ReadResult<Vec<Option<AgentAction>>> {
    names
        .iter()
        .map(|name| match actions.get(name) {
            None | Some(Value::Null) => Ok(None),
            Some(Value::Number(index)) => index
                .as_u64()
                .map(|index| Some(AgentAction::Index(index as usize)))
                .ok_or_else(|| format!("the action {index} is not an index")),
            Some(target) => {
                let wanted = text_of(target, "target")?;
                let index = sim.targets().iter().position(|target| target.name == wanted);
                index
                    .map(|index| Some(AgentAction::Target(index)))
                    .ok_or_else(|| format!("the action's target {wanted} is not one of the recording"))
            }
        })
        .collect()
}
