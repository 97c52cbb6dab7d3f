//! One deputy by itself.

use std::cmp::Ordering;

use crate::docking::approach::Approach;
use crate::docking::constants::{DOCKING_RADIUS_M, MASS_KG, MAX_DISTANCE_M, SATURATION};
use crate::docking::relative::{State, Step, distance, speed, speed_limit};
use crate::docking::reward::{FAILED, approach, delta_v, docking, nearness, thrusting, violation};
use crate::docking::setup::Setup;

/// Wanted speeds over the speed limit. Violating it costs more a second than the second is worth, so the first that
/// docks in time is mostly the best; the last crosses 150 m in about a minute.
const FRACTIONS: [f64; 8] = [0.98, 0.94, 0.88, 1.15, 1.4, 1.8, 2.6, 4.0];
/// Shares of the thrust bound that the wanted speed may count on for braking.
const BRAKING: [f64; 2] = [0.75, 0.4];

/// The laws that are tried, for a thrust bound in N.
pub(super) fn laws(bound: f64) -> Vec<Approach> {
    let law = |fraction: f64, share: f64| Approach {
        fraction,
        gain: MASS_KG,
        brake_distance: 0.8,
        final_speed: 0.18,
        brake_slope: 0.36,
        lateral: 1.0,
        deceleration: share * bound / MASS_KG,
    };
    FRACTIONS.iter().flat_map(|&fraction| BRAKING.map(|share| law(fraction, share))).collect()
}

/// How one deputy fared by itself under one law.
pub(super) struct Solo {
    pub(super) law: Approach,
    pub(super) docked: bool,
    /// The sum of its rewards.
    pub(super) reward: f64,
}

impl Solo {
    /// Flies it by the rules of the world, leaving collisions out. Nearness is only looked at where it counts: its
    /// changes add up to last less first.
    pub(super) fn fly(setup: &Setup, mut state: State, law: Approach) -> Self {
        let step_law = Step::one();
        let (mut spent, mut over, mut first) = (0.0, 0.0, 0.0);
        for step in 1..=setup.time_limit {
            let thrust = law.thrust(&state, setup.thrust_bound);
            state = step_law.advance(&state, thrust);
            let (d, v) = (distance(&state), speed(&state));
            let limit = speed_limit(d);
            spent += delta_v(thrust);
            over += violation(v, limit);
            if step == 1 {
                first = nearness(d);
            }
            let inside = d <= DOCKING_RADIUS_M;
            let timeout = step == setup.time_limit;
            if inside || timeout || d > MAX_DISTANCE_M || over <= SATURATION {
                let docked = inside && v <= limit;
                let mut reward = approach(first, nearness(d)) + thrusting(spent) + over;
                if docked {
                    reward += docking(f64::from(step), f64::from(setup.time_limit));
                }
                if timeout || d > MAX_DISTANCE_M || (inside && !docked) {
                    reward += FAILED;
                }
                return Self { law, docked, reward };
            }
        }
        Self { law, docked: false, reward: FAILED } // cannot be: the time limit is at least one step
    }

    /// Docked first; then the larger reward.
    pub(super) fn best_first(a: &Self, b: &Self) -> Ordering {
        b.docked.cmp(&a.docked).then(b.reward.total_cmp(&a.reward))
    }
}
