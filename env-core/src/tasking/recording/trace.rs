//! Comparison of an episode with a recording of every tick.

use serde_json::Value;

use super::compare::compare_imaged;
use super::read::{ReadResult, list_of, number, number_of, numbers, satellite_names, vector, whole};
use super::state::sigma_difference;
use super::tolerances::{ILLUMINATION, REWARD, TIME_S, trace};
use super::trace_sample::TraceSample;
use crate::difference_tally::DifferenceTally;
use crate::tasking::constants::THRUSTERS;
use crate::tasking::simulation::{AgentAction, StepResult, TaskingSim};
use crate::tasking::vector3::{Vector3, norm, scale, sub};

/// An action of a trace.
struct TracedStep {
    actions: Vec<Option<AgentAction>>,
    /// Close of the window of each target, s, so that it is known where the trace does not say how it was searched.
    closes: Vec<Option<f64>>,
    end_s: f64,
}

/// Replays the actions of a trace tick by tick and compares each tick. `recording` is the original file, `current` the same in the
/// current format.
pub(super) fn compare_trace(
    recording: &Value,
    current: &Value,
    sim: &mut TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let names = satellite_names(current)?;
    let mut samples: Vec<Vec<TraceSample>> = vec![Vec::new(); names.len()];
    let recorded = list_of(recording, steps_field(recording))?;
    for (index, step) in read_steps(recorded, &names, sim)?.iter().enumerate() {
        tally.step = index + 1;
        tally.steps += 1;
        for (index, close) in step.closes.iter().enumerate() {
            if let Some(close) = close {
                sim.compute_opportunities(index, *close).map_err(|error| error.to_string())?;
            }
        }
        let traced = sim.step_traced(&step.actions, &mut |sim| {
            for (index, samples) in samples.iter_mut().enumerate() {
                samples.push(TraceSample::of(sim, index));
            }
        });
        let result = traced.map_err(|error| error.to_string())?;
        tally.compare_numbers("step_end", sim.time_s(), step.end_s, TIME_S, format_args!("end of the step"));
        compare_result(&recorded[index], &result, &names, sim, tally)?;
    }
    for (name, samples) in names.iter().zip(&samples) {
        let series =
            recording["trace"].get(name).or_else(|| recording["satellites"].get(name)).unwrap_or(recording);
        compare_series(series, name, samples, tally)?;
    }
    Ok(())
}

/// Compares reward and images of an older trace's action.
fn compare_result(
    recorded: &Value,
    result: &StepResult,
    names: &[String],
    sim: &TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    if let Some(theirs) = recorded.get("reward").filter(|reward| reward.is_number()) {
        let ours: f64 = result.rewards.iter().sum();
        tally.compare_numbers("reward", ours, number(theirs)?, REWARD, format_args!("reward of the step"));
    }
    for (imaged, name) in result.imaged.iter().zip(names) {
        compare_imaged(&recorded["imaged"][name], *imaged, name, sim, tally);
    }
    Ok(())
}

/// Name of the list of a trace's steps, which older traces call actions.
fn steps_field(recording: &Value) -> &'static str {
    if recording.get("steps").is_some() { "steps" } else { "actions" }
}

/// Steps of the trace: those of the current format, or the scripted actions of older ones.
fn read_steps(recorded: &[Value], names: &[String], sim: &TaskingSim) -> ReadResult<Vec<TracedStep>> {
    recorded
        .iter()
        .map(|step| {
            let actions = names
                .iter()
                .enumerate()
                .map(|(index, name)| read_action(step, index, name, sim))
                .collect::<ReadResult<_>>()?;
            let close = |index: usize| step["targets"][index]["close"].as_f64();
            let closes = (0..names.len()).map(close).collect();
            Ok(TracedStep { actions, closes, end_s: number_of(step, "t_end")? })
        })
        .collect()
}

/// Action of a satellite: of the current format, of an older scanning trace, or the target of an older imaging trace.
fn read_action(step: &Value, index: usize, name: &str, sim: &TaskingSim) -> ReadResult<Option<AgentAction>> {
    let by_index = |value: &Value| value.as_u64().map(|index| AgentAction::Index(index as usize));
    if let Some(action) = step.get("action") {
        return Ok(by_index(action));
    }
    if let Some(action) = step["actions"].get(name) {
        return Ok(by_index(action));
    }
    if step["actions"].get(index).is_none_or(Value::is_null) {
        return Ok(None);
    }
    let target = &step["targets"][index];
    let wanted = target["name"].as_str().unwrap_or_default();
    let found = sim.targets().iter().position(|target| target.name == wanted);
    found.map(|target| Some(AgentAction::Target(target))).ok_or_else(|| format!("target {wanted} is missing"))
}

fn compare_series(
    series: &Value,
    name: &str,
    samples: &[TraceSample],
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let times = list_of(series, "t")?;
    for (index, time) in times.iter().enumerate() {
        let tick = number(time)?.round() as usize;
        if tick == 0 {
            continue;
        }
        let Some(ours) = tick.checked_sub(1).and_then(|index| samples.get(index)) else {
            tally.add_mismatch(format!("the replay of {name} has no tick {tick}"));
            return Ok(());
        };
        tally.step = tick;
        compare_sample(series, index, name, ours, tally)?;
        // Older recordings sample the flight software's messages before it runs: they are those of the tick before.
        let is_older = series.get("motor_torque_Nm").is_some();
        let commanded = if is_older { tick.checked_sub(2).and_then(|i| samples.get(i)) } else { Some(ours) };
        if let Some(commanded) = commanded {
            compare_commands(series, index, name, commanded, tally)?;
            // A command to the flight software clears the guidance of the last tick.
            let is_cleared = is_older && ours.commanded_at == Some(tick as u64 - 1);
            let guidance = if is_cleared { Some([0.0; 3]) } else { commanded.guidance };
            if let (Some(ours), Some(theirs)) = (guidance, series["guid_sigma_BR"].get(index)) {
                compare_vectors("guidance", &ours, theirs, trace::GUIDANCE, name, tally)?;
            }
        }
    }
    compare_pulses(series, name, samples, tally)
}

/// Compares the state after a tick.
fn compare_sample(
    series: &Value,
    index: usize,
    name: &str,
    ours: &TraceSample,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let at = |field: &str| series.get(field).and_then(|values| values.get(index));
    if let Some(theirs) = at("sigma_BN") {
        let difference = sigma_difference(&ours.sigma, &vector(theirs)?);
        tally.compare_numbers("attitude", difference, 0.0, trace::SIGMA, format_args!("attitude of {name}"));
    }
    let vectors = [
        ("rate", ours.omega, "omega_BN_B", trace::OMEGA_RAD_S),
        ("wheel_speed", ours.wheels, "wheel_speeds_rad_s", trace::WHEELS_RAD_S),
    ];
    for (quantity, ours, field, allowed) in vectors {
        if let Some(theirs) = at(field) {
            compare_vectors(quantity, &ours, theirs, allowed, name, tally)?;
        }
    }
    let places = [
        ("position", ours.position, "r_BN_N", trace::POSITION_M),
        ("velocity", ours.velocity, "v_BN_N", trace::VELOCITY_M_S),
    ];
    for (quantity, ours, field, allowed) in places {
        let Some(theirs) = at(field) else { continue };
        let apart = norm(&sub(&ours, &vector(theirs)?));
        tally.compare_numbers(quantity, apart, 0.0, allowed, format_args!("{quantity} of {name}"));
    }
    let scalars = [
        ("net_power", ours.net_power, "net_power_W", trace::POWER_W),
        ("panel_power", ours.panel_power, "panel_power_W", trace::POWER_W),
        ("illumination", ours.illumination, "illumination", ILLUMINATION),
        ("battery", ours.battery, "battery_Ws", trace::BATTERY_WS),
        ("storage", ours.stored, "storage_bits", 0.0),
    ];
    for (quantity, ours, field, allowed) in scalars {
        let Some(theirs) = at(field) else { continue };
        tally.compare_numbers(quantity, ours, number(theirs)?, allowed, format_args!("{quantity} of {name}"));
    }
    compare_target(series, index, name, ours, tally)
}

fn compare_vectors(
    quantity: &'static str,
    ours: &Vector3<f64>,
    theirs: &Value,
    allowed: f64,
    name: &str,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    for (ours, theirs) in ours.iter().zip(vector(theirs)?) {
        tally.compare_numbers(quantity, *ours, theirs, allowed, format_args!("{quantity} of {name}"));
    }
    Ok(())
}

/// Compares the satellite as its target sees it.
fn compare_target(
    series: &Value,
    index: usize,
    name: &str,
    ours: &TraceSample,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let at = |field: &str| series.get(field).and_then(|values| values.get(index));
    let Some(target) = ours.target else { return Ok(()) };
    let scalars = [
        ("elevation", target.elevation_rad, "target_elevation", trace::ELEVATION_RAD),
        ("range", target.range_m, "target_range", trace::POSITION_M),
    ];
    for (quantity, ours, field, allowed) in scalars {
        let Some(theirs) = at(field) else { continue };
        let what = format_args!("{quantity} of {name} from its target");
        tally.compare_numbers(quantity, ours, number(theirs)?, allowed, what);
    }
    if let Some(theirs) = at("target_access").and_then(whole) {
        tally.compare_outcomes(&target.has_access, &(theirs == 1), format_args!("target access of {name}"));
    }
    Ok(())
}

/// Compares the commands to wheels and thrusters of a tick.
fn compare_commands(
    series: &Value,
    index: usize,
    name: &str,
    ours: &TraceSample,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let at = |field: &str| series.get(field).and_then(|values| values.get(index));
    // The wheels turn the body the other way.
    let control = scale(&ours.command, -1.0);
    let torques = [
        (ours.command, "motor_torque_Nm"),
        (ours.command, "motor_torque_command_Nm"),
        (control, "cmd_torque_Nm"),
    ];
    for (ours, field) in torques {
        if let Some(theirs) = at(field) {
            compare_vectors("motor_torque", &ours, theirs, trace::MOTOR_TORQUE_N_M, name, tally)?;
        }
    }
    let is_dense = series["thruster_on_time_s"][index].as_array().is_some_and(|row| row.len() == THRUSTERS);
    if is_dense {
        compare_thrusters(&ours.thruster_times, &series["thruster_on_time_s"][index], name, tally)?;
    }
    Ok(())
}

/// Compares the pulses of a trace that lists only those: pairs of a time and the thrusters' on-times.
fn compare_pulses(
    series: &Value,
    name: &str,
    samples: &[TraceSample],
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let Some(pulses) = series["thruster_on_time_s"].as_array() else { return Ok(()) };
    if pulses.first().is_none_or(|pulse| pulse.as_array().is_none_or(|row| row.len() != 2)) {
        return Ok(());
    }
    let mut theirs = pulses.iter();
    for (index, ours) in
        samples.iter().enumerate().filter(|(_, ours)| ours.thruster_times != [0.0; THRUSTERS])
    {
        tally.step = index + 1;
        let Some(pulse) = theirs.next() else {
            tally.add_mismatch(format!("{name} fires, recorded as silent"));
            return Ok(());
        };
        let what = format_args!("time of a pulse of {name}");
        tally.compare_numbers(
            "thruster_time",
            (index + 1) as f64,
            number(&pulse[0])?,
            trace::THRUSTERS_S,
            what,
        );
        compare_thrusters(&ours.thruster_times, &pulse[1], name, tally)?;
    }
    if theirs.next().is_some() {
        tally.add_mismatch(format!("{name} is silent, recorded as firing"));
    }
    Ok(())
}

fn compare_thrusters(
    ours: &[f64; THRUSTERS],
    theirs: &Value,
    name: &str,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    for (ours, theirs) in ours.iter().zip(numbers(theirs)?) {
        let what = format_args!("thrusters of {name}");
        tally.compare_numbers("thruster_time", *ours, theirs, trace::THRUSTERS_S, what);
    }
    Ok(())
}
