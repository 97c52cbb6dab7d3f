//! Closed-form quantities of a deputy's start: how much of its way, time and velocity penalty an approach needs.
//!
//! Distances shrink along a straight line at the speed limit v(d) = v₀ + k(d − r) (Dunlap et al. 2023, cited in
//! `docs/worlds/docking.md`), and thrust changes speeds at a constant rate. Both are approximations: over a few minutes the
//! relative motion changes speeds by less than thrust does. Coasting paths are exact solutions of Clohessy & Wiltshire (1960).

use env_core::docking::constants::{
    DOCKING_RADIUS_M, DOCKING_SPEED_M_S, LIMIT_SLOPE_1_S, MASS_KG, MAX_DISTANCE_M, VIOLATION_COST,
};
use env_core::docking::relative_motion::{RelativeState, StepTransition, distance, speed, speed_limit};

/// Start of a deputy by distance and speeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StartApproach {
    /// Distance from the chief, m.
    pub(super) distance: f64,
    /// Speed limit at the distance, m/s.
    pub(super) limit: f64,
    /// Speed towards the chief, m/s.
    pub(super) closing: f64,
    /// Speed relative to the chief, m/s.
    pub(super) speed: f64,
    /// Acceleration by full thrust on one axis, m/s². Thrust along several axes accelerates more.
    pub(super) acceleration: f64,
}

impl StartApproach {
    /// Creates the approach of a state under a thrust bound in N.
    pub(super) fn new(state: &RelativeState, thrust_bound: f64) -> Self {
        let d = distance(state);
        let inward = state[0] * state[3] + state[1] * state[4] + state[2] * state[5];
        Self {
            distance: d,
            limit: speed_limit(d),
            closing: -inward / d.max(f64::MIN_POSITIVE),
            speed: speed(state),
            acceleration: thrust_bound / MASS_KG,
        }
    }

    /// Speed above the limit, m/s; 0 below it.
    pub(super) fn excess(&self) -> f64 {
        (self.speed - self.limit).max(0.0)
    }

    /// Returns the time to reach the chief at the speed limit, s.
    ///
    /// It is ∫ dd/v(d) from the docking radius, plus the time lost until the closing speed c reaches the limit v at the
    /// acceleration a: the way lost is (v − c)²/2a, which takes (v − c)²/2av at the limit.
    pub(super) fn needed_time(&self) -> f64 {
        let behind = (self.limit - self.closing).max(0.0);
        time_at_limit(self.distance) + behind * behind / (2.0 * self.acceleration * self.limit)
    }

    /// Returns the share of the way to the docking radius that braking from the closing speed c to the docking speed v₀ takes:
    /// (c² − v₀²)/2a over the way. 0 if c is not above v₀.
    pub(super) fn braking_share(&self) -> f64 {
        let way = (self.distance - DOCKING_RADIUS_M).max(f64::MIN_POSITIVE);
        let speeds = self.closing.max(0.0) * self.closing.max(0.0) - DOCKING_SPEED_M_S * DOCKING_SPEED_M_S;
        (speeds / (2.0 * self.acceleration * way)).max(0.0)
    }

    /// Returns the velocity penalty that braking to the limit costs, as a positive number. With the excess e and the time
    /// e/a it is 0.01(e + e²/2)/a: 0.01 for each second and 0.01 for each m/s of excess.
    pub(super) fn braking_penalty(&self) -> f64 {
        let excess = self.excess();
        VIOLATION_COST * (excess + 0.5 * excess * excess) / self.acceleration
    }

    /// Returns the distance at which thrust stops a deputy that flies away from the chief, m.
    pub(super) fn turning_distance(&self) -> f64 {
        let away = (-self.closing).max(0.0);
        self.distance + away * away / (2.0 * self.acceleration)
    }
}

/// Returns the time from a distance to the docking radius at the speed limit, s: ∫ dd/v(d) = ln(v(d)/v₀)/k.
pub(super) fn time_at_limit(distance: f64) -> f64 {
    libm::log(speed_limit(distance) / DOCKING_SPEED_M_S) / LIMIT_SLOPE_1_S
}

/// Returns the distance from which the approach at the speed limit takes a time in s: the inverse of [`time_at_limit`], in m.
pub(super) fn distance_at_limit(seconds: f64) -> f64 {
    DOCKING_RADIUS_M
        + DOCKING_SPEED_M_S * (libm::exp(LIMIT_SLOPE_1_S * seconds.max(0.0)) - 1.0) / LIMIT_SLOPE_1_S
}

/// Returns the excess whose [`StartApproach::braking_penalty`] is `penalty`, m/s: the root of e + e²/2 = 100·a·penalty.
pub(super) fn excess_for_penalty(penalty: f64, acceleration: f64) -> f64 {
    (1.0 + 2.0 * penalty * acceleration / VIOLATION_COST).sqrt() - 1.0
}

/// Returns the step after which a coasting deputy is out of bounds, within `steps`; `None` if it stays.
pub(super) fn step_out_of_bounds(start: &RelativeState, steps: u32) -> Option<u32> {
    let mut state = *start;
    (1..=steps).find(|_| {
        state = StepTransition::world_step().advance(&state, [0.0; 3]);
        distance(&state) > MAX_DISTANCE_M
    })
}

/// Nearest pass of two coasting deputies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MutualPass {
    /// Step after which they are nearest to each other.
    pub(super) step: u32,
    /// Their distance then, m.
    pub(super) separation: f64,
}

/// Returns the nearest pass of two coasting deputies within `steps`. The difference of two solutions of the equations of motion
/// is a solution, too.
pub(super) fn nearest_pass(a: &RelativeState, b: &RelativeState, steps: u32) -> MutualPass {
    let mut difference: RelativeState = std::array::from_fn(|i| a[i] - b[i]);
    let mut nearest = MutualPass { step: 0, separation: distance(&difference) };
    for step in 1..=steps {
        difference = StepTransition::world_step().advance(&difference, [0.0; 3]);
        let separation = distance(&difference);
        if separation < nearest.separation {
            nearest = MutualPass { step, separation };
        }
    }
    nearest
}

/// Returns the separation of two deputies when the first of them reaches the docking radius, if both fly straight to the chief at
/// the speed limit, m. Each needs its [`StartApproach::needed_time`]; their lines meet at an angle.
pub(super) fn separation_on_arrival(a: &StartApproach, b: &StartApproach, angle_deg: f64) -> f64 {
    let late = (a.needed_time() - b.needed_time()).abs();
    let (first, second) = (DOCKING_RADIUS_M, distance_at_limit(late));
    let cos = libm::cos(angle_deg.to_radians());
    (first * first + second * second - 2.0 * first * second * cos).max(0.0).sqrt()
}
