//! Parameters of the trainable reflex: twelve numbers and no search.
//!
//! For each satellite the policy forecasts the first visible debris that would come closer than a threshold
//! under hold. Once that is soon enough, it burns in a direction given by a 2×2 map of where the debris will
//! pass. Look-ahead, threshold, wait, size and map have to be learnt. Rendezvous adds the gains of the
//! transfer, formation those of formation keeping.

use crate::kessler::constants::HORIZON;
use crate::kessler::planner::formation::FormationGains;
use crate::reflex::{self, ParameterMeaning};
use crate::seed::Seed;

/// Number of parameters of the reflex.
pub const KESSLER_REFLEX_LEN: usize = 12;

/// Parameters of the reflex, each in [0, 1]; their names are [`KesslerReflexParameters::NAMES`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KesslerReflexParameters(pub [f64; KESSLER_REFLEX_LEN]);

impl KesslerReflexParameters {
    /// Names of the parameters, in order. The first eight serve every task, the last four the transfer of
    /// rendezvous. Formation uses the last four as its gains: gain, steps forecast, unused, tolerance.
    pub const NAMES: [&str; KESSLER_REFLEX_LEN] = [
        "look_ahead",
        "miss_threshold",
        "wait",
        "burn_size",
        "map_radial_radial",
        "map_radial_in_track",
        "map_in_track_radial",
        "map_in_track_in_track",
        "transfer_gain",
        "transfer_circularise",
        "transfer_climb",
        "transfer_deadband",
    ];

    /// Creates parameters from numbers; missing ones are ½.
    #[must_use]
    pub fn from_numbers(numbers: &[f64]) -> Self {
        Self(reflex::parameter_array(numbers))
    }

    /// Samples uniform random parameters: the learner starts from them, and `frozen` keeps them.
    #[must_use]
    pub fn random(seed: Seed) -> Self {
        Self(reflex::random_parameters(seed))
    }

    /// Physical meanings of the parameters, in order.
    #[must_use]
    pub fn meanings(&self) -> [ParameterMeaning; KESSLER_REFLEX_LEN] {
        let g = self.gains();
        let [rr, rt, tr, tt] = g.map;
        let values = [
            (g.look_ahead as f64, "steps"),
            (g.threshold, "LU"),
            (g.wait as f64, "steps"),
            (g.size, "LU/TU"),
            (rr, ""),
            (rt, ""),
            (tr, ""),
            (tt, ""),
            (g.gain, "1/TU"),
            (g.circularise, ""),
            (g.climb, "LU/TU"),
            (g.deadband, "LU/TU"),
        ];
        std::array::from_fn(|i| {
            let (value, unit) = values[i];
            ParameterMeaning { name: Self::NAMES[i], value, unit }
        })
    }

    /// Scales the parameters to the gains of the policy.
    pub(super) fn gains(&self) -> ReflexGains {
        let p = reflex::clamp_parameters(self.0);
        let scale = |i: usize, low: f64, high: f64| low + (high - low) * p[i];
        ReflexGains {
            look_ahead: scale(0, 1.0, 25.0) as usize,
            threshold: scale(1, 1.0, 6.0),
            wait: scale(2, 1.0, 25.0) as usize,
            size: 0.02 * libm::pow(50.0, p[3]), // 0.02 to 1 LU/TU, log-uniform
            map: [scale(4, -1.0, 1.0), scale(5, -1.0, 1.0), scale(6, -1.0, 1.0), scale(7, -1.0, 1.0)],
            gain: scale(8, 0.0, 1.0),
            circularise: scale(9, 0.0, 1.0),
            climb: scale(10, 0.2, 4.5),
            deadband: scale(11, 0.0, 0.3),
        }
    }
}

/// Gains of the reflex in physical units.
pub(super) struct ReflexGains {
    /// Steps that debris is forecast.
    pub look_ahead: usize,
    /// Distance below which debris is avoided, LU.
    pub threshold: f64,
    /// Steps before a close approach within which the satellite burns.
    pub wait: usize,
    /// Size of an avoidance burn, LU/TU.
    pub size: f64,
    /// Matrix from the direction in which the debris passes to that of the burn, radial and in-track: rr, rt,
    /// tr, tt. Only the direction of the result counts.
    pub map: [f64; 4],
    /// Gain of the radius feedback, 1/TU; see `radius_feedback`.
    pub gain: f64,
    /// Weight of the in-track correction of the radius feedback.
    pub circularise: f64,
    /// Fastest climb of the radius feedback, LU/TU.
    pub climb: f64,
    /// Size below which a transfer burn is left out, LU/TU.
    pub deadband: f64,
}

impl ReflexGains {
    /// Gains of formation keeping, from the last four parameters: forecasts up to 6 steps, tolerance up to 4
    /// LU.
    pub(super) fn formation_gains(&self) -> FormationGains {
        let ahead = 1.0 + 5.0 * self.circularise;
        let tolerance = self.deadband / 0.3 * 4.0;
        FormationGains { ahead: ahead as u32, gain: self.gain, tolerance, until: HORIZON }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_out_of_range_are_clamped() {
        let low = KesslerReflexParameters([-1.0; KESSLER_REFLEX_LEN]);
        let high = KesslerReflexParameters([2.0; KESSLER_REFLEX_LEN]);
        assert_eq!(low.meanings(), KesslerReflexParameters([0.0; KESSLER_REFLEX_LEN]).meanings());
        assert_eq!(high.meanings(), KesslerReflexParameters([1.0; KESSLER_REFLEX_LEN]).meanings());
        let nan = KesslerReflexParameters([f64::NAN; KESSLER_REFLEX_LEN]);
        assert_eq!(nan.meanings(), KesslerReflexParameters([0.5; KESSLER_REFLEX_LEN]).meanings());
        let ranges: Vec<(f64, f64)> =
            low.meanings().iter().zip(high.meanings()).map(|(low, high)| (low.value, high.value)).collect();
        assert_eq!(ranges[..3], [(1.0, 25.0), (1.0, 6.0), (1.0, 25.0)]);
        assert!((ranges[3].0 - 0.02).abs() < 1e-12 && (ranges[3].1 - 1.0).abs() < 1e-12);
    }
}
