//! One deputy by itself.

use std::cmp::Ordering;

use crate::docking::approach::Approach;
use crate::docking::constants::MASS_KG;
use crate::docking::deputy::Deputy;
use crate::docking::relative::{State, Step};
use crate::docking::setup::Setup;

/// Wanted speeds over the speed limit. Violating it costs more a second than the second is worth, so the first that
/// docks in time is mostly the best; the last crosses 150 m in about a minute.
const FRACTIONS: [f64; 8] = [0.98, 0.94, 0.88, 1.15, 1.4, 1.8, 2.6, 4.0];
/// Shares of the thrust bound that the wanted speed may count on for braking.
const BRAKING: [f64; 2] = [0.75, 0.4];

/// The laws that are tried, for a thrust bound in N.
pub(in crate::docking) fn laws(bound: f64) -> Vec<Approach> {
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
pub(in crate::docking) struct Solo {
    pub(in crate::docking) law: Approach,
    pub(in crate::docking) docked: bool,
    /// The sum of its rewards.
    pub(in crate::docking) reward: f64,
}

impl Solo {
    /// Flies it by the rules of the world, from a state as if that were the start; collisions are left out.
    pub(in crate::docking) fn fly(setup: &Setup, state: State, law: Approach) -> Self {
        let mut deputy = Deputy::at(state);
        let mut step = 0;
        while deputy.flies() {
            step += 1;
            let thrust = law.thrust(&deputy.state, setup.thrust_bound);
            deputy.fly(Step::one(), setup, step, thrust);
        }
        Self { law, docked: deputy.ends.docked, reward: deputy.earned }
    }

    /// Docked first; then the larger reward.
    pub(in crate::docking) fn best_first(a: &Self, b: &Self) -> Ordering {
        b.docked.cmp(&a.docked).then(b.reward.total_cmp(&a.reward))
    }
}
