//! Observations of a satellite, as BSK-RL composes them.
//!
//! [`spec`] describes an observation and names its values; [`property`] and [`opportunity`] compute them from a
//! [`view::SatelliteView`]; [`eclipse`] forecasts eclipses as BSK-RL samples them.

pub mod eclipse;
pub mod opportunity;
pub mod property;
pub mod spec;
pub mod view;
