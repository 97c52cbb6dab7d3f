//! Conversions of units that the language of tasking uses.

/// Seconds of a minute.
pub(super) const S_PER_MINUTE: f64 = 60.0;
/// Seconds of a day.
pub(super) const S_PER_DAY: f64 = 86_400.0;
/// Joules of a watt-hour.
pub(super) const J_PER_WH: f64 = 3600.0;
/// Metres of a kilometre.
pub(super) const M_PER_KM: f64 = 1000.0;
