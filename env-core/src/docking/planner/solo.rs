//! One deputy by itself.

use std::cmp::Ordering;

use crate::docking::approach::Approach;
use crate::docking::constants::MASS_KG;
use crate::docking::deputy::Deputy;
use crate::docking::relative::{State, Step};
use crate::docking::setup::Setup;

/// Wanted speeds over the speed limit, within it.
const WITHIN: [f64; 3] = [0.98, 0.93, 0.87];
/// And beyond it; the last crosses 150 m in about a minute.
const BEYOND: [f64; 5] = [1.15, 1.4, 1.8, 2.6, 4.0];
/// Shares of the thrust bound that the wanted speed may count on for braking.
const BRAKING: [f64; 2] = [0.75, 0.4];

fn laws(fractions: &[f64], bound: f64) -> impl Iterator<Item = Approach> {
    fractions.iter().flat_map(move |&fraction| {
        BRAKING.map(|share| Approach {
            fraction,
            gain: MASS_KG,
            brake_distance: 0.8,
            final_speed: 0.18,
            brake_slope: 0.36,
            lateral: 1.0,
            deceleration: share * bound / MASS_KG,
        })
    })
}

/// How one deputy fared by itself under one law.
pub(in crate::docking) struct Solo {
    pub(in crate::docking) law: Approach,
    pub(in crate::docking) docked: bool,
    /// The sum of its rewards, those before included.
    pub(in crate::docking) reward: f64,
}

impl Solo {
    /// Flies it on by the rules of the world, from where it was after a step (0 is the start): what is left of its time
    /// and what it has been paid so far go with it. Collisions are left out.
    pub(in crate::docking) fn fly(setup: &Setup, mut deputy: Deputy, mut step: u32, law: Approach) -> Self {
        while deputy.flies() {
            step += 1;
            let thrust = law.thrust(&deputy.state, setup.thrust_bound);
            deputy.fly(Step::one(), setup, step, thrust);
        }
        Self { law, docked: deputy.ends.docked, reward: deputy.earned }
    }

    /// The deputy by itself under every law worth trying, the best first. A second at f times the limit v costs
    /// 0.01 + 0.01(f − 1)v and saves f − 1 seconds, worth (f − 1)/T: less than it costs wherever vT ≥ 100 m. So laws beyond
    /// the limit are tried only where none within it docks in time.
    pub(super) fn ranked(setup: &Setup, state: State) -> Vec<Self> {
        let fly = |law| Self::fly(setup, Deputy::at(state), 0, law);
        let mut solos: Vec<Self> = laws(&WITHIN, setup.thrust_bound).map(fly).collect();
        if !solos.iter().any(|solo| solo.docked) {
            solos.extend(laws(&BEYOND, setup.thrust_bound).map(fly));
        }
        solos.sort_by(Self::best_first);
        solos
    }

    /// Docked first; then the larger reward.
    fn best_first(a: &Self, b: &Self) -> Ordering {
        b.docked.cmp(&a.docked).then(b.reward.total_cmp(&a.reward))
    }
}
