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
    /// All deputies: at the start, and after each step. Those that have left stay.
    deputies: Vec<[Deputy; MAX_DEPUTIES]>,
    /// Thrusts of all deputies in each step, within the bound.
    thrusts: Vec<Thrusts>,
    /// The step after which each deputy was gone.
    left: [u32; MAX_DEPUTIES],
}

impl Course {
    /// Flies the log again.
    pub(super) fn fly(scenario: &Scenario, log: &ActionLog) -> Result<Self, ReplayError> {
        replay(scenario, log)?; // what is wrong with the log is said in one place
        let setup = Setup::read(scenario.recipe())?;
        let start = setup.start(&mut Seeded::new(scenario.seed()))?;
        let mut flight = Flight::new(setup, &start);
        let room = log.len() + 1;
        let mut course = Self {
            deputies: Vec::with_capacity(room),
            thrusts: Vec::with_capacity(room),
            left: [0; MAX_DEPUTIES],
            flight: flight.clone(),
        };
        course.note(&flight);
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
            course.thrusts.push(thrusts);
            course.note(&flight);
            for (left, _) in course.left.iter_mut().zip(stepped.live_before).filter(|(_, live)| *live) {
                *left = flight.steps();
            }
        }
        course.flight = flight;
        Ok(course)
    }

    fn note(&mut self, flight: &Flight) {
        let mut deputies = [Deputy::default(); MAX_DEPUTIES];
        deputies[..flight.deputies().len()].copy_from_slice(flight.deputies());
        self.deputies.push(deputies);
    }

    /// How many deputies there are.
    pub(super) fn count(&self) -> usize {
        self.flight.deputies().len()
    }

    /// The step after which a deputy was gone.
    pub(super) fn left(&self, deputy: usize) -> u32 {
        self.left[deputy]
    }

    /// A deputy after a step; 0 is the start.
    pub(super) fn deputy(&self, deputy: usize, step: u32) -> &Deputy {
        &self.deputies[(step as usize).min(self.deputies.len() - 1)][deputy]
    }

    /// Its state.
    pub(super) fn state(&self, deputy: usize, step: u32) -> &State {
        &self.deputy(deputy, step).state
    }

    /// The thrust of a deputy in a step, counted from 1.
    pub(super) fn thrust(&self, deputy: usize, step: u32) -> [f64; 3] {
        let index = (step as usize).checked_sub(1);
        index.and_then(|index| self.thrusts.get(index)).map_or([0.0; 3], |thrusts| thrusts[deputy])
    }

    /// The deputies that collided at the end, as pairs.
    pub(super) fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.flight.events().iter().filter_map(|event| match event {
            Event::Collided { first, second, .. } => Some((*first as usize, *second as usize)),
            _ => None,
        })
    }
}
