//! The recorded trajectory of a finished episode.

use crate::docking::constants::MAX_DEPUTIES;
use crate::docking::deputy::Deputy;
use crate::docking::event::DockingEvent;
use crate::docking::relative_motion::RelativeState;
use crate::docking::setup::DockingSetup;
use crate::docking::simulation::{DockingSim, Thrusts};
use crate::episode_rng::SeededRng;
use crate::error::ReplayError;
use crate::log::ActionLog;
use crate::rollout::replay;
use crate::task::Scenario;

/// States and thrusts of all deputies in a finished episode.
pub(super) struct DockingTrajectory {
    /// The simulation at the end of the episode.
    pub(super) sim: DockingSim,
    /// All deputies at the start, then after each step; those that have left keep their last state.
    deputies: Vec<Deputy>,
    /// Thrusts of all deputies in each step, clamped; zero for those that have left.
    thrusts: Vec<[f64; 3]>,
    /// The last step of each deputy.
    last_steps: [u32; MAX_DEPUTIES],
}

impl DockingTrajectory {
    /// Replays a log and records all states.
    pub(super) fn replay(scenario: &Scenario, log: &ActionLog) -> Result<Self, ReplayError> {
        let steps = replay(scenario, log)?.steps as usize; // reports all errors of a log
        let setup = DockingSetup::read(scenario.recipe())?;
        let start = setup.sample_starts(&mut SeededRng::new(scenario.seed()))?;
        let mut sim = DockingSim::new(setup, &start);
        let count = sim.deputies().len();
        let mut deputies = Vec::with_capacity(count * (steps + 1));
        let mut recorded_thrusts = Vec::with_capacity(count * steps);
        let mut left = [0; MAX_DEPUTIES];
        deputies.extend_from_slice(sim.deputies());
        while !sim.is_done() {
            let action = log.step(sim.steps() as usize);
            let mut thrusts: Thrusts = [[0.0; 3]; MAX_DEPUTIES];
            for (&agent, values) in action.agents.iter().zip(action.values.chunks_exact(3)) {
                if let Some(sum) = thrusts.get_mut(agent as usize) {
                    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
                }
            }
            let bound = setup.thrust_bound;
            let thrusts = thrusts.map(|thrust| thrust.map(|axis| axis.clamp(-bound, bound)));
            let result = sim.apply_thrusts(thrusts);
            let live = result.active_before.iter().zip(&thrusts);
            recorded_thrusts
                .extend(live.take(count).map(|(live, thrust)| if *live { *thrust } else { [0.0; 3] }));
            deputies.extend_from_slice(sim.deputies());
            for (left, _) in left.iter_mut().zip(result.active_before).filter(|(_, live)| *live) {
                *left = sim.steps();
            }
        }
        Ok(Self { sim, deputies, thrusts: recorded_thrusts, last_steps: left })
    }

    /// Number of deputies at the start.
    pub(super) fn deputy_count(&self) -> usize {
        self.sim.deputies().len()
    }

    /// The last step of a deputy.
    pub(super) fn last_step(&self, deputy: usize) -> u32 {
        self.last_steps[deputy]
    }

    /// A deputy after a step; 0 is the start, and a step past the end is the end.
    pub(super) fn deputy(&self, deputy: usize, step: u32) -> &Deputy {
        &self.deputies[step.min(self.sim.steps()) as usize * self.deputy_count() + deputy]
    }

    /// State of a deputy after a step.
    pub(super) fn state(&self, deputy: usize, step: u32) -> &RelativeState {
        &self.deputy(deputy, step).state
    }

    /// Thrust of a deputy in a step, counted from 1; zero once it has left.
    pub(super) fn thrust(&self, deputy: usize, step: u32) -> [f64; 3] {
        let before = (step as usize).checked_sub(1);
        let index = before.map(|before| before * self.deputy_count() + deputy);
        index.and_then(|index| self.thrusts.get(index)).copied().unwrap_or_default()
    }

    /// Pairs of deputies that collided at the end.
    pub(super) fn collided_pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.sim.events().iter().filter_map(|event| match event {
            DockingEvent::Collided { first, second, .. } => Some((*first as usize, *second as usize)),
            _ => None,
        })
    }
}
