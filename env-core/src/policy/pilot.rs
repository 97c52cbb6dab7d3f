//! Policies as worlds write them: acting on the world's own observation.

use std::any::Any;
use std::marker::PhantomData;

use super::Policy;
use crate::log::ActionLog;

/// A policy that acts on observations of type `T`.
pub(crate) trait Pilot<T>: Send {
    /// Appends this step's actions to `log`, which is closed after it.
    fn fly(&mut self, seen: &T, log: &mut ActionLog);
}

/// A pilot as a policy.
pub(crate) fn seated<T: Any>(pilot: impl Pilot<T> + 'static) -> Box<dyn Policy> {
    Box::new(Seat { pilot, sees: PhantomData::<fn(&T)> })
}

struct Seat<P, T> {
    pilot: P,
    sees: PhantomData<fn(&T)>,
}

impl<T: Any, P: Pilot<T>> Policy for Seat<P, T> {
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog) {
        // An observation of another world says nothing to this pilot: it holds.
        if let Some(seen) = observation.downcast_ref::<T>() {
            self.pilot.fly(seen, log);
        }
        log.end_step();
    }
}

/// Does nothing.
pub(crate) struct Hold;

impl<T> Pilot<T> for Hold {
    fn fly(&mut self, _: &T, _: &mut ActionLog) {}
}

/// Follows a plan step by step.
pub(crate) struct Witness {
    plan: ActionLog,
    step: usize,
}

impl Witness {
    pub(crate) const fn new(plan: ActionLog) -> Self {
        Self { plan, step: 0 }
    }
}

impl<T> Pilot<T> for Witness {
    fn fly(&mut self, _: &T, log: &mut ActionLog) {
        let action = self.plan.step(self.step);
        self.step += 1;
        for (&agent, values) in action.agents.iter().zip(action.values.chunks_exact(self.plan.dim())) {
            log.act(agent, values);
        }
    }
}
