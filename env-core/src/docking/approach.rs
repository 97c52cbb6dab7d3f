//! The proportional approach: a wanted velocity straight at the chief, and a thrust in proportion to what is missing.
//! Pilot, planner and reflex are this law at different numbers.

use super::constants::DOCKING_RADIUS_M;
use super::relative::{State, distance, limit_line};

/// The law's numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// Wanted speed over the speed limit, outside the brake distance.
    pub fraction: f64,
    /// Thrust per missing speed, N·s/m. With the mass of 12 kg, 12 makes up for all of it in one step.
    pub gain: f64,
    /// Inside this distance, m, the last two numbers hold.
    pub brake_distance: f64,
    /// Wanted speed inside the brake distance, m/s.
    pub final_speed: f64,
    /// Wanted speed per distance where that is less, 1/s.
    pub brake_slope: f64,
    /// Share of the gain that speed across the line to the chief is met with.
    pub lateral: f64,
    /// Deceleration the wanted speed allows for, m/s²; infinite plans for none.
    pub deceleration: f64,
}

impl Approach {
    /// The reference policy: 0.85 of the speed limit, and min(0.1, 0.3 d) within 3 m.
    pub const PILOT: Self = Self {
        fraction: 0.85,
        gain: 12.0,
        brake_distance: 3.0,
        final_speed: 0.1,
        brake_slope: 0.3,
        lateral: 1.0,
        deceleration: f64::INFINITY,
    };

    /// Wanted speed towards the chief at a distance, m/s.
    #[inline]
    #[must_use]
    pub fn speed_at(&self, distance: f64) -> f64 {
        if distance < self.brake_distance {
            return self.final_speed.min(self.brake_slope * distance);
        }
        let wanted = self.fraction * limit_line(distance);
        if self.deceleration.is_infinite() {
            return wanted;
        }
        let run = (distance - self.brake_distance.max(DOCKING_RADIUS_M)).max(0.0);
        let stoppable = self.final_speed * self.final_speed + 2.0 * self.deceleration * run;
        wanted.min(stoppable.sqrt())
    }

    /// The thrust, N, each axis within ± `bound`.
    #[inline]
    #[must_use]
    pub fn thrust(&self, s: &State, bound: f64) -> [f64; 3] {
        let d = distance(s).max(f64::MIN_POSITIVE);
        let along = self.speed_at(d) / d;
        // What is missing: the wanted velocity −along·p, less the velocity.
        let missing: [f64; 3] = std::array::from_fn(|i| -along * s[i] - s[i + 3]);
        let across = if self.lateral == 1.0 {
            [0.0; 3]
        } else {
            let radial = (missing[0] * s[0] + missing[1] * s[1] + missing[2] * s[2]) / (d * d);
            std::array::from_fn(|i| missing[i] - radial * s[i])
        };
        std::array::from_fn(|i| {
            let wanted = self.gain * (missing[i] + (self.lateral - 1.0) * across[i]);
            wanted.clamp(-bound, bound)
        })
    }
}
