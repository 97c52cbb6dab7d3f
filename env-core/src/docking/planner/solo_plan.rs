//! Plans of one deputy by itself.

use std::cmp::Ordering;

use crate::docking::approach_law::ApproachLaw;
use crate::docking::constants::MASS_KG;
use crate::docking::deputy::Deputy;
use crate::docking::relative_motion::{RelativeState, StepTransition};
use crate::docking::setup::DockingSetup;

/// Target speeds divided by the speed limit, below it.
const FRACTIONS_WITHIN_LIMIT: [f64; 3] = [0.98, 0.93, 0.87];
/// Target speeds divided by the speed limit, above it; the last crosses 150 m in about a minute.
const FRACTIONS_BEYOND_LIMIT: [f64; 5] = [1.15, 1.4, 1.8, 2.6, 4.0];
/// Shares of the thrust bound that the target speed assumes for braking.
const BRAKING_SHARES: [f64; 2] = [0.75, 0.4];

fn candidate_laws(fractions: &[f64], bound: f64) -> impl Iterator<Item = ApproachLaw> {
    fractions.iter().flat_map(move |&fraction| {
        BRAKING_SHARES.map(|share| ApproachLaw {
            speed_fraction: fraction,
            gain: MASS_KG,
            brake_distance: 0.8,
            final_speed: 0.18,
            brake_slope: 0.36,
            lateral_ratio: 1.0,
            deceleration: share * bound / MASS_KG,
        })
    })
}

/// Outcome of one deputy by itself under one law.
pub(in crate::docking) struct SoloPlan {
    pub(in crate::docking) law: ApproachLaw,
    pub(in crate::docking) docked: bool,
    /// Sum of the deputy's rewards from the start of the episode.
    pub(in crate::docking) reward: f64,
}

impl SoloPlan {
    /// Simulates a deputy to its end, from its state after `step` (0 is the start). Its remaining time and its rewards so
    /// far are kept; collisions are ignored.
    pub(in crate::docking) fn simulate(
        setup: &DockingSetup,
        mut deputy: Deputy,
        mut step: u32,
        law: ApproachLaw,
    ) -> Self {
        while deputy.is_active() {
            step += 1;
            let thrust = law.thrust(&deputy.state, setup.thrust_bound);
            deputy.step(StepTransition::world_step(), setup, step, thrust);
        }
        Self { law, docked: deputy.end_conditions.docked, reward: deputy.total_reward }
    }

    /// The plans of all candidate laws, best first.
    ///
    /// A second at f times the limit v costs 0.01 + 0.01(f − 1)v and saves f − 1 seconds, worth (f − 1)/T. That is less than
    /// its cost wherever vT ≥ 100 m. So laws above the limit are tried only if none below it docks in time.
    pub(super) fn ranked(setup: &DockingSetup, state: RelativeState) -> Vec<Self> {
        let simulate = |law| Self::simulate(setup, Deputy::new(state), 0, law);
        let mut solos: Vec<Self> =
            candidate_laws(&FRACTIONS_WITHIN_LIMIT, setup.thrust_bound).map(simulate).collect();
        if !solos.iter().any(|solo| solo.docked) {
            solos.extend(candidate_laws(&FRACTIONS_BEYOND_LIMIT, setup.thrust_bound).map(simulate));
        }
        solos.sort_by(Self::best_first);
        solos
    }

    /// Orders docked plans first, then by descending reward.
    fn best_first(a: &Self, b: &Self) -> Ordering {
        b.docked.cmp(&a.docked).then(b.reward.total_cmp(&a.reward))
    }
}
