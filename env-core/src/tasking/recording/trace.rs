//! Comparison of an episode with a recording of every tick.

use serde_json::Value;

use super::compare::sigma_difference;
use super::read::{ReadResult, list_of, number, number_of, numbers, satellite_names, vector};
use crate::difference_tally::DifferenceTally;
use crate::tasking::constants::THRUSTERS;
use crate::tasking::simulation::{AgentAction, TaskingSim};
use crate::tasking::vector3::{Vector3, norm, sub};

/// Largest allowed differences of each tick.
pub mod tolerances {
    /// MRP of the attitude.
    pub const SIGMA: f64 = 1e-7;
    /// Angular velocity of the body, rad/s.
    pub const OMEGA_RAD_S: f64 = 1e-8;
    /// Speeds of the wheels, rad/s.
    pub const WHEELS_RAD_S: f64 = 1e-4;
    /// Net power of the battery, W.
    pub const NET_POWER_W: f64 = 1e-3;
    /// Charge of the battery, W·s.
    pub const BATTERY_WS: f64 = 0.1;
    /// Commanded motor torque, N·m.
    pub const MOTOR_TORQUE_N_M: f64 = 1e-5;
    /// Position of the satellite, m.
    pub const POSITION_M: f64 = 0.5;
}

/// State of a satellite after a tick of the replay.
#[derive(Debug, Clone)]
struct Sample {
    sigma: Vector3<f64>,
    omega: Vector3<f64>,
    wheels: Vector3<f64>,
    command: Vector3<f64>,
    position: Vector3<f64>,
    battery: f64,
    net_power: f64,
    stored: f64,
    thruster_times: [f64; THRUSTERS],
}

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
    let mut samples: Vec<Vec<Sample>> = vec![Vec::new(); names.len()];
    for (index, step) in read_steps(recording, &names, sim)?.iter().enumerate() {
        tally.step = index + 1;
        tally.steps += 1;
        for (index, close) in step.closes.iter().enumerate() {
            if let Some(close) = close {
                sim.compute_opportunities(index, *close).map_err(|error| error.to_string())?;
            }
        }
        let traced = sim.step_traced(&step.actions, &mut |sim| {
            for (index, samples) in samples.iter_mut().enumerate() {
                samples.push(sample(sim, index));
            }
        });
        traced.map_err(|error| error.to_string())?;
        tally.compare_numbers("step_end", sim.time_s(), step.end_s, 1e-6, format_args!("end of the step"));
    }
    for (name, samples) in names.iter().zip(&samples) {
        let series =
            recording["trace"].get(name).or_else(|| recording["satellites"].get(name)).unwrap_or(recording);
        compare_series(series, name, samples, tally)?;
    }
    Ok(())
}

fn sample(sim: &TaskingSim, index: usize) -> Sample {
    let satellite = sim.satellite(index);
    let state = &satellite.state;
    Sample {
        sigma: state.attitude.sigma,
        omega: state.attitude.omega,
        wheels: state.attitude.wheels,
        command: state.command,
        position: state.position,
        battery: state.battery,
        net_power: state.net_power,
        stored: state.stored,
        thruster_times: satellite.commanded_thrust(sim.now()),
    }
}

/// Steps of the trace: those of the current format, or the scripted actions of older ones.
fn read_steps(recording: &Value, names: &[String], sim: &TaskingSim) -> ReadResult<Vec<TracedStep>> {
    let field = if recording.get("steps").is_some() { "steps" } else { "actions" };
    list_of(recording, field)?
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
    samples: &[Sample],
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
        }
    }
    compare_pulses(series, name, samples, tally)
}

/// Compares the state after a tick.
fn compare_sample(
    series: &Value,
    index: usize,
    name: &str,
    ours: &Sample,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let at = |field: &str| series.get(field).and_then(|values| values.get(index));
    if let Some(theirs) = at("sigma_BN") {
        let difference = sigma_difference(&ours.sigma, &vector(theirs)?);
        tally.compare_numbers(
            "attitude",
            difference,
            0.0,
            tolerances::SIGMA,
            format_args!("attitude of {name}"),
        );
    }
    let vectors = [
        ("rate", ours.omega, "omega_BN_B", tolerances::OMEGA_RAD_S),
        ("wheel_speed", ours.wheels, "wheel_speeds_rad_s", tolerances::WHEELS_RAD_S),
    ];
    for (quantity, ours, field, allowed) in vectors {
        let Some(theirs) = at(field) else { continue };
        for (ours, theirs) in ours.iter().zip(vector(theirs)?) {
            tally.compare_numbers(quantity, *ours, theirs, allowed, format_args!("{quantity} of {name}"));
        }
    }
    if let Some(theirs) = at("r_BN_N") {
        let apart = norm(&sub(&ours.position, &vector(theirs)?));
        tally.compare_numbers(
            "position",
            apart,
            0.0,
            tolerances::POSITION_M,
            format_args!("position of {name}"),
        );
    }
    let scalars = [
        ("net_power", ours.net_power, "net_power_W", tolerances::NET_POWER_W),
        ("battery", ours.battery, "battery_Ws", tolerances::BATTERY_WS),
        ("storage", ours.stored, "storage_bits", 0.0),
    ];
    for (quantity, ours, field, allowed) in scalars {
        if let Some(theirs) = at(field) {
            tally.compare_numbers(
                quantity,
                ours,
                number(theirs)?,
                allowed,
                format_args!("{quantity} of {name}"),
            );
        }
    }
    Ok(())
}

/// Compares the commands to wheels and thrusters of a tick.
fn compare_commands(
    series: &Value,
    index: usize,
    name: &str,
    ours: &Sample,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let motor = series.get("motor_torque_Nm").or_else(|| series.get("motor_torque_command_Nm"));
    if let Some(theirs) = motor.and_then(|values| values.get(index)) {
        for (ours, theirs) in ours.command.iter().zip(vector(theirs)?) {
            let what = format_args!("motor torque of {name}");
            tally.compare_numbers("motor_torque", *ours, theirs, tolerances::MOTOR_TORQUE_N_M, what);
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
    samples: &[Sample],
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
        tally.compare_numbers("thruster_time", (index + 1) as f64, number(&pulse[0])?, 1e-6, what);
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
        tally.compare_numbers("thruster_time", *ours, theirs, 1e-6, format_args!("thrusters of {name}"));
    }
    Ok(())
}
