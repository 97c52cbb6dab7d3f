//! Assigns the episodes of a pool to the slots of a batch, and records the actions of each episode.
//!
//! Slots take episodes in order before each step, so that the assignment does not depend on threads. Start reading at
//! [`EpisodeAssigner`].

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{Autoreset, BatchShape, ScenarioSource};
use crate::log::{ActionLog, Precision};
use crate::space::ActionSpace;
use crate::task::Scenario;

/// Initial capacity of an episode's recorded actions, in values. An episode of docking that runs to its end takes 70 kB,
/// most take less, so it begins with a page or two.
const INITIAL_ACTION_CAPACITY: usize = 2048;

/// Supplies episodes, and takes back those that are not run to their end.
pub trait EpisodePool {
    /// Identifier of an episode.
    type EpisodeId: Clone;

    /// Takes the next episode that no slot runs.
    fn take_episode(&mut self) -> Option<PooledEpisode<Self::EpisodeId>>;

    /// Takes back an episode that is not run to its end.
    fn return_episode(&mut self, episode: PooledEpisode<Self::EpisodeId>);
}

/// An episode of a pool.
#[derive(Debug, Clone)]
pub struct PooledEpisode<I> {
    /// Identifier of the episode.
    pub id: I,
    /// Scenario of the episode.
    pub scenario: Scenario,
}

/// The call of a batch that follows an assignment.
#[derive(Debug, Clone, Copy)]
pub enum BatchCall<'a> {
    /// A step. Slots without an episode begin one, and under [`Autoreset::SameStep`] also those whose episode ends.
    Step,
    /// A reset of all slots, or of those in the mask.
    Reset(Option<&'a [bool]>),
}

/// Source with the next scenario of each slot, if one is assigned. Clones share the assignment.
#[derive(Debug, Clone)]
pub struct AssignedScenarios {
    next: Arc<Mutex<Vec<Option<Scenario>>>>,
    /// Scenario of slots without an assignment; it is never started.
    placeholder: Scenario,
}

impl AssignedScenarios {
    /// Creates a source without assignments, except for `first` in the first slot: a batch reads it to find its shape.
    #[must_use]
    pub fn new(envs: usize, first: &Scenario) -> Self {
        let mut next = vec![None; envs];
        if let Some(slot) = next.first_mut() {
            *slot = Some(first.clone());
        }
        Self { next: Arc::new(Mutex::new(next)), placeholder: first.clone() }
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Option<Scenario>>> {
        // No holder of the lock can panic; if one did, the assignment would still be valid.
        self.next.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ScenarioSource for AssignedScenarios {
    fn scenario(&self, slot: usize, _: u64) -> Scenario {
        self.lock().get(slot).cloned().flatten().unwrap_or_else(|| self.placeholder.clone())
    }

    fn has_scenario(&self, slot: usize) -> bool {
        self.lock().get(slot).is_some_and(Option::is_some)
    }
}

/// Actions of an episode, step by step.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedActions {
    agents: usize,
    space: ActionSpace,
    values: Vec<f32>,
}

impl RecordedActions {
    /// Number of recorded steps.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.len() / self.step_len()
    }

    /// Number of recorded values.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.values.len()
    }

    /// True if no step is recorded.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Actions of each step: those of all agents, one after the other.
    pub fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.values.chunks_exact(self.step_len())
    }

    /// Converts the actions to an action log in single precision.
    #[must_use]
    pub fn to_log(&self) -> ActionLog {
        let mut log = ActionLog::new(self.space.dim(), Precision::F32);
        self.rows().for_each(|step| log.push_by_agent(&self.space, step));
        log
    }

    /// Number of values of one step, at least 1.
    fn step_len(&self) -> usize {
        (self.agents * self.space.dim()).max(1)
    }
}

/// An episode that is assigned to a slot.
#[derive(Debug, Clone)]
pub struct AssignedEpisode<I> {
    /// Identifier of the episode.
    pub id: I,
    /// Scenario of the episode.
    pub scenario: Scenario,
    /// Actions of the steps so far.
    pub actions: RecordedActions,
    /// Sum of the team's rewards so far; the score is this sum, clamped to the task's range.
    pub team_return: f64,
    /// Version of the policy when the episode began.
    pub version: u32,
}

impl<I> AssignedEpisode<I> {
    fn new(shape: BatchShape, PooledEpisode { id, scenario }: PooledEpisode<I>) -> Self {
        let task = scenario.task();
        let agents = (task.agents(scenario.recipe()) as usize).min(shape.agents);
        let len = task.horizon(scenario.recipe()) as usize * agents * shape.action;
        let values = Vec::with_capacity(len.min(INITIAL_ACTION_CAPACITY));
        let actions = RecordedActions { agents, space: task.action_space(), values };
        Self { id, scenario, actions, team_return: 0.0, version: 0 }
    }

    fn into_pooled(self) -> PooledEpisode<I> {
        PooledEpisode { id: self.id, scenario: self.scenario }
    }
}

/// Assigns the episodes of a pool to the slots of a batch.
///
/// The caller calls [`assign`](Self::assign) before each reset or step of the batch, and
/// [`record_reset`](Self::record_reset) or [`record_step`](Self::record_step) after it.
pub struct EpisodeAssigner<I> {
    shape: BatchShape,
    autoreset: Autoreset,
    assigned: AssignedScenarios,
    running: Vec<Option<AssignedEpisode<I>>>,
    next: Vec<Option<AssignedEpisode<I>>>,
    finished: Vec<AssignedEpisode<I>>,
    /// Version of the policy for episodes that begin now.
    pub version: u32,
}

impl<I: Clone> EpisodeAssigner<I> {
    /// Creates an assigner for a batch of this shape with the source `assigned`.
    #[must_use]
    pub fn new(assigned: AssignedScenarios, shape: BatchShape, autoreset: Autoreset) -> Self {
        let none = || (0..shape.envs).map(|_| None).collect();
        Self { shape, autoreset, assigned, running: none(), next: none(), finished: Vec::new(), version: 0 }
    }

    /// Assigns episodes, slot by slot in order, to all slots that may begin one in the next call of the batch. Returns the
    /// number of slots for which the pool had no episode.
    pub fn assign(&mut self, pool: &mut dyn EpisodePool<EpisodeId = I>, call: BatchCall<'_>) -> usize {
        let mut assigned = self.assigned.lock();
        let (mut has_more, mut unassigned) = (true, 0); // an empty pool is asked once, not for every slot
        for (slot, next) in self.next.iter_mut().enumerate() {
            if next.is_some() {
                continue; // assigned before
            }
            if may_begin(self.autoreset, call, slot, self.running[slot].is_some()) {
                if has_more {
                    *next = pool.take_episode().map(|episode| AssignedEpisode::new(self.shape, episode));
                    has_more = next.is_some();
                }
                unassigned += usize::from(next.is_none());
            }
            assigned[slot] = next.as_ref().map(|episode| episode.scenario.clone());
        }
        unassigned
    }

    /// True if a slot that may begin an episode in the next call of the batch has none assigned.
    #[must_use]
    pub fn needs_assignment(&self, call: BatchCall<'_>) -> bool {
        let mut slots = self.next.iter().zip(&self.running).enumerate();
        slots.any(|(slot, (next, running))| {
            next.is_none() && may_begin(self.autoreset, call, slot, running.is_some())
        })
    }

    /// Assigns the running episode once more to each slot in the mask of a reset for which the pool had none.
    pub fn repeat_unassigned(&mut self, mask: Option<&[bool]>) {
        let mut assigned = self.assigned.lock();
        for (slot, next) in self.next.iter_mut().enumerate() {
            if next.is_none()
                && is_selected(mask, slot)
                && let Some(episode) = self.running[slot].take()
            {
                assigned[slot] = Some(episode.scenario.clone());
                *next = Some(AssignedEpisode::new(self.shape, episode.into_pooled()));
            }
        }
    }

    /// Returns the running episodes of all slots, or of those in the mask, to the pool.
    pub fn return_running(&mut self, pool: &mut dyn EpisodePool<EpisodeId = I>, mask: Option<&[bool]>) {
        for (slot, running) in self.running.iter_mut().enumerate() {
            if is_selected(mask, slot)
                && let Some(episode) = running.take()
            {
                pool.return_episode(episode.into_pooled());
            }
        }
    }

    /// Drops the running episodes without returning them to the pool; returns their ids.
    pub fn abandon(&mut self) -> Vec<I> {
        self.running.iter_mut().filter_map(Option::take).map(|episode| episode.id).collect()
    }

    /// Records a reset of all slots, or of those in the mask: they now run their assigned episodes.
    pub fn record_reset(&mut self, mask: Option<&[bool]>) {
        for slot in 0..self.running.len() {
            if is_selected(mask, slot) {
                self.begin(slot);
            }
        }
    }

    /// Records a step of all slots, or of those in the mask: its actions, the team's rewards, and the slots whose episodes ended.
    pub fn record_step(
        &mut self,
        mask: Option<&[bool]>,
        executed_actions: &[f32],
        team_rewards: &[f32],
        done: &[bool],
    ) {
        let BatchShape { agents, action, .. } = self.shape;
        let rows = executed_actions.chunks_exact((agents * action).max(1)).enumerate();
        for (slot, actions) in rows.filter(|(slot, _)| is_selected(mask, *slot)) {
            let Some(episode) = &mut self.running[slot] else {
                self.begin(slot); // this step was the reset of the slot
                continue;
            };
            let present = episode.actions.agents * action;
            episode.actions.values.extend_from_slice(&actions[..present]);
            episode.team_return += f64::from(team_rewards[slot]);
            if done[slot] {
                self.finished.extend(self.running[slot].take());
                if self.autoreset == Autoreset::SameStep {
                    self.begin(slot);
                }
            }
        }
    }

    /// Takes the episodes that ended since the last call.
    pub fn take_finished(&mut self) -> Vec<AssignedEpisode<I>> {
        std::mem::take(&mut self.finished)
    }

    /// The running episode of each slot.
    pub fn running(&self) -> impl Iterator<Item = Option<&AssignedEpisode<I>>> {
        self.running.iter().map(Option::as_ref)
    }

    /// Returns all episodes that did not end, running or assigned, to the pool.
    pub fn return_all(&mut self, pool: &mut dyn EpisodePool<EpisodeId = I>) {
        for episode in self.running.iter_mut().chain(&mut self.next).filter_map(Option::take) {
            pool.return_episode(episode.into_pooled());
        }
    }

    fn begin(&mut self, slot: usize) {
        let next = self.next[slot].take();
        self.running[slot] = next.map(|episode| AssignedEpisode { version: self.version, ..episode });
    }
}

/// True if a slot may begin an episode in the next call of the batch.
fn may_begin(autoreset: Autoreset, call: BatchCall<'_>, slot: usize, is_running: bool) -> bool {
    match (call, autoreset) {
        (BatchCall::Reset(mask), _) => is_selected(mask, slot),
        (BatchCall::Step, Autoreset::NextStep) => !is_running,
        (BatchCall::Step, Autoreset::SameStep) => true,
        (BatchCall::Step, Autoreset::Disabled) => false,
    }
}

/// True if a slot is in the mask; no mask selects all slots.
fn is_selected(mask: Option<&[bool]>, slot: usize) -> bool {
    mask.is_none_or(|mask| mask[slot])
}
