//! Comparison of a satellite's state with a recorded one.

use serde_json::Value;

use super::read::{ReadResult, number, number_of, vector, vector_of};
use super::tolerances;
use crate::difference_tally::DifferenceTally;
use crate::tasking::constants::RAD_S_PER_RPM;
use crate::tasking::observation::property::Property;
use crate::tasking::simulation::TaskingSim;
use crate::tasking::vector3::{Vector3, dot, norm, sub};

/// Difference of two attitudes: the smaller one to the recorded MRP or its shadow.
pub(super) fn sigma_difference(ours: &Vector3<f64>, theirs: &Vector3<f64>) -> f64 {
    let largest = |v: Vector3<f64>| v.iter().fold(0.0_f64, |max, x| max.max(x.abs()));
    let square = dot(theirs, theirs);
    let shadow = theirs.map(|x| -x / square);
    largest(sub(ours, theirs)).min(if square > 0.0 { largest(sub(ours, &shadow)) } else { f64::INFINITY })
}

/// Compares what a recorded state has with the state now.
pub(super) fn compare_state(
    recorded: &Value,
    index: usize,
    name: &str,
    sim: &mut TaskingSim,
    tick_s: f64,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    compare_attitude(recorded, index, name, sim, tally)?;
    compare_resources(recorded, index, name, sim, tally)?;
    compare_orbit(recorded, index, name, sim, tick_s, tally)?;
    compare_pointing(recorded, index, name, sim, tally)?;
    compare_checks(recorded, index, name, sim, tally);
    if let Some(theirs) = recorded.get("net_power_W") {
        let (ours, what) = (sim.satellite(index).net_power_w(), format_args!("net power of {name}"));
        tally.compare_numbers("net_power", ours, number(theirs)?, tolerances::NET_POWER_W, what);
    }
    if let Some(theirs) = recorded.get("illumination_factor") {
        let (ours, what) = (sim.illumination(index), format_args!("illumination of {name}"));
        tally.compare_numbers("illumination", ours, number(theirs)?, tolerances::ILLUMINATION, what);
    }
    compare_eclipse(recorded, index, name, sim, tally)
}

fn compare_attitude(
    recorded: &Value,
    index: usize,
    name: &str,
    sim: &TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let spec = sim.satellite(index).spec();
    let attitude = &sim.satellite(index).state.attitude;
    let difference = sigma_difference(&attitude.sigma, &vector_of(recorded, "sigma_BN")?);
    let allowed = tolerances::sigma(spec);
    tally.compare_numbers("attitude", difference, 0.0, allowed, format_args!("attitude of {name}"));
    let vectors = [
        ("rate", &attitude.omega, "omega_BN_B", tolerances::OMEGA_RAD_S),
        ("wheel_speed", &attitude.wheels, "wheel_speeds_rad_s", tolerances::WHEELS_RAD_S),
    ];
    for (quantity, ours, field, allowed) in vectors {
        for (ours, theirs) in ours.iter().zip(vector_of(recorded, field)?) {
            tally.compare_numbers(quantity, *ours, theirs, allowed, format_args!("{quantity} of {name}"));
        }
    }
    if let Some(theirs) = recorded.get("wheel_speeds_fraction") {
        let limit = spec.args.max_wheel_speed_rpm * RAD_S_PER_RPM;
        let shares = attitude.wheels.map(|speed| speed / limit);
        for (ours, theirs) in shares.iter().zip(vector(theirs)?) {
            let what = format_args!("share of a wheel's limit of {name}");
            tally.compare_numbers("observation", *ours, theirs, tolerances::wheel_fraction(spec), what);
        }
    }
    Ok(())
}

fn compare_resources(
    recorded: &Value,
    index: usize,
    name: &str,
    sim: &TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let satellite = sim.satellite(index);
    let (spec, stored) = (satellite.spec(), satellite.stored());
    let battery = number_of(recorded, "battery_Ws")?;
    let what = format_args!("battery of {name}");
    tally.compare_numbers("battery", satellite.battery_ws(), battery, tolerances::BATTERY_WS, what);
    for (partition, bits) in recorded["storage"].as_object().into_iter().flatten() {
        let ours = match partition.as_str() {
            "STORED DATA" if !spec.dynamics.continuous => stored[1],
            // Without a command, the data have a partition of their own.
            name if spec.records_always() && !spec.dynamics.continuous && !name.starts_with("Instrument") => {
                0.0
            }
            _ => stored[0],
        };
        tally.compare_numbers("storage", ours, number(bits)?, 0.0, format_args!("`{partition}` of {name}"));
    }
    let shares = [
        (
            "battery_charge_fraction",
            satellite.battery_ws() / spec.args.battery_capacity_ws,
            tolerances::battery_fraction(spec),
        ),
        (
            "storage_level_fraction",
            stored.iter().sum::<f64>() / spec.args.storage_capacity_bits.floor(),
            tolerances::ROUNDING,
        ),
    ];
    for (field, ours, allowed) in shares {
        if let Some(theirs) = recorded.get(field) {
            let what = format_args!("{field} of {name}");
            tally.compare_numbers("observation", ours, number(theirs)?, allowed, what);
        }
    }
    Ok(())
}

fn compare_orbit(
    recorded: &Value,
    index: usize,
    name: &str,
    sim: &mut TaskingSim,
    tick_s: f64,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    if let Some(theirs) = recorded.get("r_BN_N") {
        let apart = norm(&sub(&sim.satellite(index).state.position, &vector(theirs)?));
        let allowed = tolerances::position_m(tick_s);
        tally.compare_numbers("position", apart, 0.0, allowed, format_args!("position of {name}"));
    }
    if let Some(theirs) = recorded.get("v_BN_N") {
        let apart = norm(&sub(&sim.moment(index).velocity, &vector(theirs)?));
        let allowed = tolerances::velocity_m_s(tick_s);
        tally.compare_numbers("velocity", apart, 0.0, allowed, format_args!("velocity of {name}"));
    }
    Ok(())
}

/// Compares the angles of instrument and panel from their goals.
fn compare_pointing(
    recorded: &Value,
    index: usize,
    name: &str,
    sim: &mut TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let angles = [
        ("instrument_pointing_error_rad", Property::InstrumentPointingError),
        ("solar_pointing_error_rad", Property::SolarPointingError),
    ];
    for (field, property) in angles {
        let Some(theirs) = recorded.get(field) else { continue };
        let mut ours = Vec::new();
        let moment = sim.moment(index);
        property.write(&sim.view(index, &moment), &mut ours);
        let allowed = tolerances::direction_rad(sim.satellite(index).spec());
        let what = format_args!("{field} of {name}");
        tally.compare_numbers("pointing_error", ours[0], number(theirs)?, allowed, what);
    }
    Ok(())
}

/// Compares the conditions of BSK-RL's aliveness checkers.
fn compare_checks(recorded: &Value, index: usize, name: &str, sim: &TaskingSim, tally: &mut DifferenceTally) {
    let failures = sim.satellite(index).failures();
    for (check, holds) in recorded["checks"].as_object().into_iter().flatten() {
        if let Some(theirs) = holds.as_bool() {
            let ours = !failures.contains(&check.as_str());
            tally.compare_outcomes(&ours, &theirs, format_args!("{check} of {name}"));
        }
    }
}

/// Compares the times of the next eclipse, s.
fn compare_eclipse(
    recorded: &Value,
    index: usize,
    name: &str,
    sim: &mut TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let (Some(start), Some(end)) = (recorded.get("next_eclipse_start"), recorded.get("next_eclipse_end"))
    else {
        return Ok(());
    };
    let Some(ours) = sim.next_eclipse(index) else {
        tally.add_mismatch(format!("{name} has no next eclipse, recorded {start} s"));
        return Ok(());
    };
    for (ours, theirs) in ours.into_iter().zip([number(start)?, number(end)?]) {
        let what = format_args!("next eclipse of {name}");
        tally.compare_numbers("eclipse", ours, theirs, tolerances::TIME_S, what);
    }
    Ok(())
}
