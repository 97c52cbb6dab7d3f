//! The mode `wheels`: a wheel that was too fast, and where its momentum came from.

use super::death::add_last_chance;
use super::finding::Finding;
use super::trace::{Death, TaskingTrace};
use crate::critique::Measure;

/// The finding of a satellite with a wheel that was too fast. `last_chance` is the tick of the latest rescue that succeeded.
///
/// Speeds are positive in the direction in which the wheel turned at the end.
pub(super) fn find(trace: &TaskingTrace, agent: usize, death: &Death, last_chance: Option<u64>) -> Finding {
    let momentum = &death.momentum;
    let wheel = momentum.fastest();
    let sign = 1.0_f64.copysign(momentum.now_rpm[wheel]);
    let [speed, at_start, disturbance, thrusters, turns] = [
        momentum.now_rpm[wheel],
        momentum.at_start_rpm[wheel],
        momentum.disturbance_rpm[wheel],
        momentum.thrusters_rpm[wheel],
        momentum.turning_rpm(wheel),
    ]
    .map(|rpm| sign * rpm + 0.0);
    let limit = trace.run.sim.satellite(agent).spec().args.max_wheel_speed_rpm;
    let died_s = trace.time_s(death.tick);
    let mut finding = Finding {
        mode: "wheels",
        agent,
        tick: death.tick,
        orbit_angle_deg: None,
        loss: 1.0,
        measures: vec![
            Measure::new("time", died_s, "s"),
            Measure::new("wheel", wheel as f64, ""),
            Measure::new("speed", speed, "rpm"),
            Measure::new("limit", limit, "rpm"),
            Measure::new("at_start", at_start, "rpm"),
            Measure::new("disturbance", disturbance, "rpm"),
            Measure::new("turns", turns, "rpm"),
            Measure::new("thrusters", thrusters, "rpm"),
        ],
        explanation: format!(
            "Satellite {agent} died at {died_s:.0} s: wheel {wheel} turned at {speed:.0} rpm, and its limit is {limit:.0} rpm. It had \
             {at_start:.0} rpm at the start; the disturbing torque added {disturbance:.0} rpm, turns of the body {turns:.0} rpm and the \
             thrusters {thrusters:.0} rpm."
        ),
    };
    add_last_chance(&mut finding, trace, "Desaturating", last_chance);
    finding
}
