//! Sunlight as the planners reckon it.

use crate::tasking::vector3::{Vector3, dot};

/// Cosine of the angle between panel and Sun, at least 0. The panel is opposite to the instrument, which has this direction.
pub(super) fn panel_cosine(boresight: &Vector3<f64>, sun: &Vector3<f64>) -> f64 {
    (-dot(boresight, sun)).max(0.0)
}

/// Times from the start of each sample until the Sun shines again, s; 0 in sunlight. The samples are the powers of a panel that faces
/// the Sun, `step_s` apart.
pub(super) fn dark_times(
    panel_powers_w: impl DoubleEndedIterator<Item = f64> + ExactSizeIterator,
    step_s: f64,
) -> Vec<f64> {
    let mut times = vec![0.0; panel_powers_w.len()];
    let mut dark_s = 0.0;
    for (time, power_w) in times.iter_mut().zip(panel_powers_w).rev() {
        dark_s = if power_w > 0.0 { 0.0 } else { dark_s + step_s };
        *time = dark_s;
    }
    times
}
