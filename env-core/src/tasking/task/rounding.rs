//! Rounding of numbers that are shown, so that their JSON is short.

/// Rounds a number to some decimals.
pub(super) fn round(value: f64, decimals: i32) -> f64 {
    let factor = libm::pow(10.0, f64::from(decimals));
    libm::round(value * factor) / factor
}
