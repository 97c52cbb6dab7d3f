//! Episodes that come from somebody, one by one, and whose actions go back to them: who flies which, and what was done.
//!
//! Slots take episodes in order before each step, so that who flies what does not depend on threads.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{Autoreset, Feed, Shape};
use crate::log::{ActionLog, Precision};
use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;

/// Where episodes come from, and go back to where they are not flown to their end.
pub trait Pool {
    /// What an episode is known by.
    type Name: Clone;
    /// The next episode that nobody flies.
    fn take(&mut self) -> Option<(Self::Name, Scenario)>;
    /// One that was taken and is not flown to its end.
    fn give_back(&mut self, name: Self::Name, scenario: Scenario);
}

/// A scenario to begin with.
type Start = (Arc<Recipe>, Seed);

/// What each slot begins next; none where nothing is left for it. A batch is fed with it.
#[derive(Debug, Clone)]
pub struct Assigned {
    starts: Arc<Mutex<Vec<Option<Start>>>>,
    /// What a slot that has nothing would fly: it is never begun.
    otherwise: Start,
}

impl Assigned {
    /// Nothing for nobody, but for this scenario, which a batch looks at to see how much room it needs, for the first.
    #[must_use]
    pub fn new(envs: usize, first: &Scenario) -> Self {
        let otherwise = (Arc::clone(first.recipe()), first.seed());
        let mut starts = vec![None; envs];
        if let Some(slot) = starts.first_mut() {
            *slot = Some(otherwise.clone());
        }
        Self { starts: Arc::new(Mutex::new(starts)), otherwise }
    }

    fn hold(&self) -> MutexGuard<'_, Vec<Option<Start>>> {
        // Nothing that holds it can panic; if something did, what is assigned still is.
        self.starts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Feed for Assigned {
    fn scenario(&self, slot: usize, _: u64) -> Start {
        self.hold().get(slot).cloned().flatten().unwrap_or_else(|| self.otherwise.clone())
    }

    fn has(&self, slot: usize) -> bool {
        self.hold().get(slot).is_some_and(Option::is_some)
    }
}

/// What was done in an episode, step after step.
#[derive(Debug, Clone, PartialEq)]
pub struct Tape {
    agents: usize,
    action: usize,
    values: Vec<f32>,
}

impl Tape {
    /// Steps recorded.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.len() / (self.agents * self.action).max(1)
    }

    /// Values of an action.
    #[must_use]
    pub const fn action(&self) -> usize {
        self.action
    }

    /// Numbers recorded.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether nothing was recorded yet.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Step by step what the agents did, one after another.
    pub fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.values.chunks_exact((self.agents * self.action).max(1))
    }

    /// The same as an action log, in single precision.
    #[must_use]
    pub fn log(&self) -> ActionLog {
        let mut log = ActionLog::new(self.action, Precision::F32);
        let mut values = vec![0.0; self.action];
        for step in self.rows() {
            for (agent, acted) in (0u32..).zip(step.chunks_exact(self.action)) {
                values.iter_mut().zip(acted).for_each(|(value, acted)| *value = f64::from(*acted));
                log.act(agent, &values);
            }
            log.end_step();
        }
        log
    }
}

/// An episode that a slot has, or is to have.
#[derive(Debug, Clone)]
pub struct Flown<N> {
    /// What it is known by.
    pub name: N,
    /// What is flown.
    pub scenario: Scenario,
    /// What was done so far.
    pub tape: Tape,
    /// What the team has earned so far; the score is this, held within the task's range.
    pub earned: f64,
    /// The policy's version when it began.
    pub version: u32,
}

/// The book.
pub struct Book<N> {
    shape: Shape,
    autoreset: Autoreset,
    assigned: Assigned,
    flying: Vec<Option<Flown<N>>>,
    next: Vec<Option<Flown<N>>>,
    finished: Vec<Flown<N>>,
    /// The policy that flies what begins now.
    pub version: u32,
}

impl<N: Clone> Book<N> {
    /// For a batch of this shape that is fed with `assigned`.
    #[must_use]
    pub fn new(assigned: Assigned, shape: Shape, autoreset: Autoreset) -> Self {
        let none = || (0..shape.envs).map(|_| None).collect();
        Self { shape, autoreset, assigned, flying: none(), next: none(), finished: Vec::new(), version: 0 }
    }

    /// Decides, slot by slot in order, what is begun next, by those that will begin in what follows: a reset of all or some
    /// (`reset`), or a step, in which those begin that are over, or, where the same step resets, whoever's episode ends. How many
    /// of them there was no episode for.
    pub fn assign(&mut self, pool: &mut dyn Pool<Name = N>, reset: Option<Option<&[bool]>>) -> usize {
        let begins = begins(self.autoreset, reset);
        let mut assigned = self.assigned.hold();
        let (mut left, mut without) = (true, 0); // a pool of which nothing is left is not asked for every slot
        for (slot, next) in self.next.iter_mut().enumerate() {
            if next.is_some() {
                continue; // assigned before
            }
            if begins(slot, self.flying[slot].is_some()) {
                if left {
                    *next = pool.take().map(|(name, scenario)| begin(self.shape, name, scenario));
                    left = next.is_some();
                }
                without += usize::from(next.is_none());
            }
            assigned[slot] = next.as_ref().map(start_of);
        }
        without
    }

    /// Whether anybody will begin for whom nothing is assigned yet.
    #[must_use]
    pub fn needs(&self, reset: Option<Option<&[bool]>>) -> bool {
        let begins = begins(self.autoreset, reset);
        let mut slots = self.next.iter().zip(&self.flying).enumerate();
        slots.any(|(slot, (next, flying))| next.is_none() && begins(slot, flying.is_some()))
    }

    /// Those that are reset, and for whom nothing was left, begin what they fly once more.
    pub fn again(&mut self, mask: Option<&[bool]>) {
        let mut assigned = self.assigned.hold();
        for (slot, next) in self.next.iter_mut().enumerate() {
            if next.is_none()
                && mask.is_none_or(|mask| mask[slot])
                && let Some(flown) = self.flying[slot].take()
            {
                let flown = begin(self.shape, flown.name, flown.scenario);
                assigned[slot] = Some(start_of(&flown));
                *next = Some(flown);
            }
        }
    }

    /// What is flown by those that are reset before their end is given back.
    pub fn give_up(&mut self, pool: &mut dyn Pool<Name = N>, mask: Option<&[bool]>) {
        for (slot, flying) in self.flying.iter_mut().enumerate() {
            if mask.is_none_or(|mask| mask[slot])
                && let Some(flown) = flying.take()
            {
                pool.give_back(flown.name, flown.scenario);
            }
        }
    }

    /// What is flown is left for good; what it was known by.
    pub fn abandon(&mut self) -> Vec<N> {
        self.flying.iter_mut().filter_map(Option::take).map(|flown| flown.name).collect()
    }

    /// Those that were reset fly what was assigned to them.
    pub fn began(&mut self, mask: Option<&[bool]>) {
        for slot in 0..self.flying.len() {
            if mask.is_none_or(|mask| mask[slot]) {
                self.start(slot);
            }
        }
    }

    fn start(&mut self, slot: usize) {
        self.flying[slot] = self.next[slot].take().map(|flown| Flown { version: self.version, ..flown });
    }

    /// A step was taken with these actions, earned so much, and ended these episodes.
    pub fn stepped(&mut self, taken: &[f32], team_rewards: &[f32], done: &[bool]) {
        let Shape { agents, action, .. } = self.shape;
        for (slot, taken) in taken.chunks_exact((agents * action).max(1)).enumerate() {
            let Some(flown) = &mut self.flying[slot] else {
                self.start(slot); // this step was its reset
                continue;
            };
            let present = flown.tape.agents * action;
            flown.tape.values.extend_from_slice(&taken[..present]);
            flown.earned += f64::from(team_rewards[slot]);
            if done[slot] {
                self.finished.extend(self.flying[slot].take());
                if self.autoreset == Autoreset::SameStep {
                    self.start(slot);
                }
            }
        }
    }

    /// What was flown to its end since this was asked last.
    pub fn finished(&mut self) -> Vec<Flown<N>> {
        std::mem::take(&mut self.finished)
    }

    /// What each slot flies.
    pub fn flying(&self) -> impl Iterator<Item = Option<&Flown<N>>> {
        self.flying.iter().map(Option::as_ref)
    }

    /// Gives all back that is not flown to its end.
    pub fn close(&mut self, pool: &mut dyn Pool<Name = N>) {
        for flown in self.flying.iter_mut().chain(&mut self.next).filter_map(Option::take) {
            pool.give_back(flown.name, flown.scenario);
        }
    }
}

/// Who will begin in what follows: a slot, and whether it flies.
fn begins<'a>(
    autoreset: Autoreset,
    reset: Option<Option<&'a [bool]>>,
) -> impl Fn(usize, bool) -> bool + use<'a> {
    move |slot, flies| match (reset, autoreset) {
        (Some(mask), _) => mask.is_none_or(|mask| mask[slot]),
        (None, Autoreset::NextStep) => !flies,
        (None, Autoreset::SameStep) => true,
        (None, Autoreset::Disabled) => false,
    }
}

fn start_of<N>(flown: &Flown<N>) -> Start {
    (Arc::clone(flown.scenario.recipe()), flown.scenario.seed())
}

fn begin<N>(shape: Shape, name: N, scenario: Scenario) -> Flown<N> {
    let task = scenario.task();
    let agents = (task.agents(scenario.recipe()) as usize).min(shape.agents);
    let room = task.horizon(scenario.recipe()) as usize * agents * shape.action;
    // An episode of docking that flies to its end takes 70 kB, most take less: no more than a page or two to begin with.
    let values = Vec::with_capacity(room.min(2048));
    Flown { name, tape: Tape { agents, action: shape.action, values }, scenario, earned: 0.0, version: 0 }
}
