//! The course of a finished episode, kept for looking back.

use crate::chance::Seeded;
use crate::docking::constants::MAX_DEPUTIES;
use crate::docking::deputy::Deputy;
use crate::docking::event::Event;
use crate::docking::flight::{Flight, Thrusts};
use crate::docking::relative::State;
use crate::docking::setup::Setup;
use crate::log::ActionLog;
use crate::rollout::{ReplayError, replay};
use crate::scenario::Scenario;

/// The course of a finished episode.
pub(super) struct Course {
    /// The flight at its end.
    pub(super) flight: Flight,
    /// All deputies at the start, then after each step. Those that have left stay.
    deputies: Vec<Deputy>,
    /// Thrusts of all deputies in each step, within the bound; none of those that have left, whatever the log says.
    thrusts: Vec<[f64; 3]>,
    /// The step after which each deputy was gone.
    left: [u32; MAX_DEPUTIES],
}

impl Course {
    /// Flies the log again.
    pub(super) fn fly(scenario: &Scenario, log: &ActionLog) -> Result<Self, ReplayError> {
        let steps = replay(scenario, log)?.steps as usize; // what is wrong with a log is said in one place
        let setup = Setup::read(scenario.recipe())?;
        let start = setup.start(&mut Seeded::new(scenario.seed()))?;
        let mut flight = Flight::new(setup, &start);
        let count = flight.deputies().len();
        let mut deputies = Vec::with_capacity(count * (steps + 1));
        let mut flown = Vec::with_capacity(count * steps);
        let mut left = [0; MAX_DEPUTIES];
        deputies.extend_from_slice(flight.deputies());
        while !flight.done() {
            let action = log.step(flight.steps() as usize);
            let mut thrusts: Thrusts = [[0.0; 3]; MAX_DEPUTIES];
            for (&agent, values) in action.agents.iter().zip(action.values.chunks_exact(3)) {
                if let Some(sum) = thrusts.get_mut(agent as usize) {
                    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
                }
            }
            let bound = setup.thrust_bound;
            let thrusts = thrusts.map(|thrust| thrust.map(|axis| axis.clamp(-bound, bound)));
            let stepped = flight.fly(thrusts);
            let live = stepped.live_before.iter().zip(&thrusts);
            flown.extend(live.take(count).map(|(live, thrust)| if *live { *thrust } else { [0.0; 3] }));
            deputies.extend_from_slice(flight.deputies());
            for (left, _) in left.iter_mut().zip(stepped.live_before).filter(|(_, live)| *live) {
                *left = flight.steps();
            }
        }
        Ok(Self { flight, deputies, thrusts: flown, left })
    }

    /// How many deputies there are.
    pub(super) fn count(&self) -> usize {
        self.flight.deputies().len()
    }

    /// The step after which a deputy was gone.
    pub(super) fn left(&self, deputy: usize) -> u32 {
        self.left[deputy]
    }

    /// A deputy after a step; 0 is the start, and what is past the end is the end.
    pub(super) fn deputy(&self, deputy: usize, step: u32) -> &Deputy {
        &self.deputies[step.min(self.flight.steps()) as usize * self.count() + deputy]
    }

    /// Its state.
    pub(super) fn state(&self, deputy: usize, step: u32) -> &State {
        &self.deputy(deputy, step).state
    }

    /// The thrust of a deputy in a step, counted from 1; none once it has left.
    pub(super) fn thrust(&self, deputy: usize, step: u32) -> [f64; 3] {
        let before = (step as usize).checked_sub(1);
        let index = before.map(|before| before * self.count() + deputy);
        index.and_then(|index| self.thrusts.get(index)).copied().unwrap_or_default()
    }

    /// The deputies that collided at the end, as pairs.
    pub(super) fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.flight.events().iter().filter_map(|event| match event {
            Event::Collided { first, second, .. } => Some((*first as usize, *second as usize)),
            _ => None,
        })
    }
}
