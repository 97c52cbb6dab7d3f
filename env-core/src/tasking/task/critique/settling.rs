//! Time that an instrument still needed after the window of its target had closed.

use crate::tasking::simulation::TaskingSim;
use crate::tasking::vector3::{Vector3, norm, sub};

/// Longest time that is simulated, s.
pub(super) const MAX_SETTLING_S: f64 = 300.0;

/// Time from now until the instrument points at the target of the last command within the tolerances of an image, s; `None` if that
/// takes longer than [`MAX_SETTLING_S`]. The rate relative to the target is that of the attitude error: 4 |dσ/dt| of small MRPs.
pub(super) fn settling_s(sim: &TaskingSim, index: usize) -> Option<f64> {
    let args = &sim.satellite(index).spec().args;
    let (tolerance, rate) = (args.attitude_tolerance, args.rate_tolerance_rad_s.unwrap_or(f64::INFINITY));
    let tick = sim.tick_length();
    let start_s = sim.time_s();
    let mut alone = sim.single(index);
    let end = sim.now() + (MAX_SETTLING_S / tick.seconds()) as u64;
    alone.go_on_until(0, end);
    alone.end_at(end);
    let mut last: Vector3<f64> = sim.satellite(index).state.previous_sigma;
    let mut settled = None;
    let result = alone.step_traced(&[None], &mut |now| {
        let error = now.satellite(0).state.previous_sigma;
        let error_rate = 4.0 * norm(&sub(&error, &last)) / tick.seconds();
        if settled.is_none() && norm(&error) <= tolerance && error_rate <= rate {
            settled = Some(now.time_s() - start_s);
        }
        last = error;
    });
    result.ok().and(settled)
}
