//! The proportional approach law: a target velocity straight at the chief, and a thrust proportional to the velocity error.
//!
//! The heuristic policy, the planner and the reflex use this law with different parameters.

use super::constants::DOCKING_RADIUS_M;
use super::relative_motion::{RelativeState, distance, extended_speed_limit};

/// Parameters of the law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ApproachLaw {
    /// Target speed divided by the speed limit, outside the brake distance.
    pub speed_fraction: f64,
    /// Thrust per velocity error, N·s/m. With a mass of 12 kg, a gain of 12 corrects the whole error in one step.
    pub gain: f64,
    /// Distance within which `final_speed` and `brake_slope` apply, m.
    pub brake_distance: f64,
    /// Largest target speed inside the brake distance, m/s.
    pub final_speed: f64,
    /// Largest ratio of target speed and distance inside the brake distance, 1/s.
    pub brake_slope: f64,
    /// Share of the gain that corrects velocity across the line to the chief.
    pub lateral_ratio: f64,
    /// Deceleration from which the target speed can be stopped, m/s²; infinity imposes no limit.
    pub deceleration: f64,
}

impl ApproachLaw {
    /// The heuristic policy: 0.85 of the speed limit, and min(0.1, 0.3 d) within 3 m.
    pub const HEURISTIC: Self = Self {
        speed_fraction: 0.85,
        gain: 12.0,
        brake_distance: 3.0,
        final_speed: 0.1,
        brake_slope: 0.3,
        lateral_ratio: 1.0,
        deceleration: f64::INFINITY,
    };

    /// Target speed towards the chief at a distance, m/s.
    #[inline]
    #[must_use]
    pub fn target_speed(&self, distance: f64) -> f64 {
        if distance < self.brake_distance {
            return self.final_speed.min(self.brake_slope * distance);
        }
        let target = self.speed_fraction * extended_speed_limit(distance);
        if self.deceleration.is_infinite() {
            return target;
        }
        let run = (distance - self.brake_distance.max(DOCKING_RADIUS_M)).max(0.0);
        let stoppable = self.final_speed * self.final_speed + 2.0 * self.deceleration * run;
        target.min(stoppable.sqrt())
    }

    /// Thrust in N, each axis within ± `bound`.
    #[inline]
    #[must_use]
    pub fn thrust(&self, s: &RelativeState, bound: f64) -> [f64; 3] {
        let d = distance(s).max(f64::MIN_POSITIVE);
        let along = self.target_speed(d) / d;
        // The velocity error: the target velocity −along·p minus the velocity.
        let error: [f64; 3] = std::array::from_fn(|i| -along * s[i] - s[i + 3]);
        let across = if self.lateral_ratio == 1.0 {
            [0.0; 3]
        } else {
            let radial = (error[0] * s[0] + error[1] * s[1] + error[2] * s[2]) / (d * d);
            std::array::from_fn(|i| error[i] - radial * s[i])
        };
        std::array::from_fn(|i| {
            let thrust = self.gain * (error[i] + (self.lateral_ratio - 1.0) * across[i]);
            thrust.clamp(-bound, bound)
        })
    }
}
