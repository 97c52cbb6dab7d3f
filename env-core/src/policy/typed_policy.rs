//! Policies on a world's own type of observation, and their conversion to [`Policy`].

use std::any::Any;
use std::marker::PhantomData;

use super::{Policy, PolicyError};
use crate::log::ActionLog;

/// A policy that acts on observations of type `T`.
pub(crate) trait TypedPolicy<T>: Send {
    /// Appends the actions of one step to `log`; the caller closes the step.
    fn append_actions(&mut self, observation: &T, log: &mut ActionLog);
}

/// Converts a typed policy to a [`Policy`].
pub(crate) fn erase_type<T: Any>(policy: impl TypedPolicy<T> + 'static) -> Box<dyn Policy> {
    Box::new(TypeErased { policy, observation: PhantomData::<fn(&T)> })
}

/// A typed policy as a [`Policy`].
struct TypeErased<P, T> {
    policy: P,
    observation: PhantomData<fn(&T)>,
}

impl<T: Any, P: TypedPolicy<T>> Policy for TypeErased<P, T> {
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog) -> Result<(), PolicyError> {
        // The policy holds on an observation of another world.
        if let Some(observation) = observation.downcast_ref::<T>() {
            self.policy.append_actions(observation, log);
        }
        log.end_step();
        Ok(())
    }
}

/// Policy without any actions.
pub(crate) struct HoldPolicy;

impl<T> TypedPolicy<T> for HoldPolicy {
    fn append_actions(&mut self, _: &T, _: &mut ActionLog) {}
}

/// Policy that replays a plan step by step.
pub(crate) struct PlanPolicy {
    plan: ActionLog,
    step: usize,
}

impl PlanPolicy {
    pub(crate) const fn new(plan: ActionLog) -> Self {
        Self { plan, step: 0 }
    }
}

impl<T> TypedPolicy<T> for PlanPolicy {
    fn append_actions(&mut self, _: &T, log: &mut ActionLog) {
        let action = self.plan.step(self.step);
        self.step += 1;
        for (&agent, values) in action.agents.iter().zip(action.values.chunks_exact(self.plan.dim())) {
            log.push_entry(agent, values);
        }
    }
}
