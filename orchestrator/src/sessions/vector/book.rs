//! Who flies which episode of a lease, what it did, and what is to be reported of it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use env_core::batch::{Autoreset, Feed};
use env_core::log::Precision;
use env_core::{ActionLog, Recipe, Scenario, Seed};

use super::super::leased::{Held, lock};
use crate::ids::EpisodeId;
use crate::training::audit::{Claim, Claimed};

/// A scenario to begin with.
pub(super) type Start = (Arc<Recipe>, Seed);

/// What each slot begins next; none where nothing is left for it.
#[derive(Debug)]
pub(super) struct Assigned(Mutex<Vec<Option<Start>>>);

impl Assigned {
    /// Nothing for nobody, but for what is said of the first.
    pub(super) fn new(envs: usize, first: Start) -> Arc<Self> {
        let mut all = vec![None; envs];
        if let Some(slot) = all.first_mut() {
            *slot = Some(first);
        }
        Arc::new(Self(Mutex::new(all)))
    }

    fn hold(&self) -> MutexGuard<'_, Vec<Option<Start>>> {
        // Nothing that holds it can panic; if something did, what is assigned still is.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A lease's episodes as a batch is fed with them.
pub(super) struct LeaseFeed {
    pub(super) assigned: Arc<Assigned>,
    /// What a slot that has nothing would fly: it is never begun.
    pub(super) otherwise: Start,
}

impl Feed for LeaseFeed {
    fn scenario(&self, slot: usize, _: u64) -> Start {
        let held = self.assigned.hold();
        held.get(slot).cloned().flatten().unwrap_or_else(|| self.otherwise.clone())
    }

    fn has(&self, slot: usize) -> bool {
        self.assigned.hold().get(slot).is_some_and(Option::is_some)
    }
}

/// An episode that a slot has or is to have.
struct Flown {
    index: i64,
    scenario: Scenario,
    agents: usize,
    log: ActionLog,
}

/// The book.
pub(super) struct Book {
    pool: Held,
    task: &'static str,
    action: usize,
    agents: usize,
    assigned: Arc<Assigned>,
    flying: Vec<Option<Flown>>,
    next: Vec<Option<Flown>>,
    /// What was flown to its end and is not handed over yet.
    finished: Vec<Claim>,
}

impl Book {
    pub(super) fn new(
        pool: Held,
        task: &'static str,
        assigned: Arc<Assigned>,
        envs: usize,
        (agents, action): (usize, usize),
    ) -> Self {
        let none = || (0..envs).map(|_| None).collect();
        Self { pool, task, action, agents, assigned, flying: none(), next: none(), finished: Vec::new() }
    }

    /// Decides, slot by slot in order, what is begun next, by those that will begin in what follows: a reset of all or some
    /// (`reset`), or a step, in which those begin that are over, or, where the same step resets, whoever's episode ends.
    pub(super) fn assign(&mut self, autoreset: Autoreset, reset: Option<Option<&[bool]>>) {
        let begins = |slot: usize, flies: bool| match (reset, autoreset) {
            (Some(mask), _) => mask.is_none_or(|mask| mask[slot]),
            (None, Autoreset::NextStep) => !flies,
            (None, Autoreset::SameStep) => true,
            (None, Autoreset::Disabled) => false,
        };
        let mut pool = lock(&self.pool);
        let mut assigned = self.assigned.hold();
        let mut left = true; // a lease of which nothing is left is not asked for every slot
        for (slot, next) in self.next.iter_mut().enumerate() {
            if left && next.is_none() && begins(slot, self.flying[slot].is_some()) {
                let taken = pool.take_of(self.task);
                left = taken.is_some();
                *next = taken.map(|(index, scenario)| {
                    let agents = scenario.task().agents(scenario.recipe()) as usize;
                    let log = ActionLog::new(self.action, Precision::F32);
                    Flown { index, scenario, agents: agents.min(self.agents), log }
                });
            }
            assigned[slot] =
                next.as_ref().map(|flown| (Arc::clone(flown.scenario.recipe()), flown.scenario.seed()));
        }
    }

    /// What was flown by those that are reset before their end is given back.
    pub(super) fn give_up(&mut self, mask: Option<&[bool]>) {
        let mut pool = lock(&self.pool);
        for (slot, flying) in self.flying.iter_mut().enumerate() {
            if mask.is_none_or(|mask| mask[slot])
                && let Some(flown) = flying.take()
            {
                pool.give_back(flown.index);
            }
        }
    }

    /// Those that were reset fly what was assigned to them.
    pub(super) fn began(&mut self, mask: Option<&[bool]>, autoreset: Autoreset) {
        for slot in 0..self.flying.len() {
            if mask.is_none_or(|mask| mask[slot]) {
                self.flying[slot] = self.next[slot].take();
            }
        }
        debug_assert!(autoreset != Autoreset::Disabled || self.next.iter().all(Option::is_none));
    }

    /// A step was taken with these actions, and ended these episodes.
    pub(super) fn stepped(&mut self, actions: &[f32], done: &[bool], autoreset: Autoreset) {
        let width = self.agents * self.action;
        let lease = lock(&self.pool).lease.clone();
        for (slot, actions) in actions.chunks_exact(width.max(1)).enumerate() {
            let Some(mut flown) = self.flying[slot].take() else {
                // This step was its reset.
                self.flying[slot] = self.next[slot].take();
                continue;
            };
            let mut values = [0.0; 16];
            for (agent, action) in actions.chunks_exact(self.action.max(1)).enumerate().take(flown.agents) {
                for (value, action) in values.iter_mut().zip(action) {
                    *value = f64::from(*action);
                }
                flown.log.act(agent as u32, &values[..self.action.min(16)]);
            }
            flown.log.end_step();
            if !done[slot] {
                self.flying[slot] = Some(flown);
                continue;
            }
            let episode = EpisodeId { lease: lease.clone(), index: flown.index }.to_string();
            let what = Claimed::Logged(flown.log);
            self.finished.push(Claim { episode, what, policy_version: None, metrics: None });
            if autoreset == Autoreset::SameStep {
                self.flying[slot] = self.next[slot].take();
            }
        }
    }

    /// What was flown to its end since this was asked last.
    pub(super) fn finished(&mut self) -> Vec<Claim> {
        std::mem::take(&mut self.finished)
    }

    /// The index in the lease of what each slot flies; −1 where it flies nothing.
    pub(super) fn episodes(&self) -> impl Iterator<Item = i32> {
        self.flying
            .iter()
            .map(|flown| flown.as_ref().and_then(|flown| i32::try_from(flown.index).ok()).unwrap_or(-1))
    }
}

impl Drop for Book {
    fn drop(&mut self) {
        let mut pool = lock(&self.pool);
        for flown in self.flying.iter().chain(&self.next).flatten() {
            pool.give_back(flown.index);
        }
    }
}
