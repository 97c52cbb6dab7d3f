//! Who flies which episode of a lease, and what is to be reported of it.

use std::sync::MutexGuard;

use env_core::Scenario;
use env_core::batch::book::{self, Assigned};
use env_core::batch::{Autoreset, Shape};

use super::super::leased::{Held, lock};
use super::super::pool;
use crate::ids::EpisodeId;
use crate::training::audit::{Claim, Claimed};

/// A lease's episodes of one task.
struct Pool<'a> {
    lease: MutexGuard<'a, pool::Pool>,
    task: &'static str,
}

impl book::Pool for Pool<'_> {
    /// The index in the lease.
    type Name = i64;

    fn take(&mut self) -> Option<(i64, Scenario)> {
        self.lease.take_of(self.task)
    }

    fn give_back(&mut self, index: i64, _: Scenario) {
        self.lease.give_back(index);
    }
}

/// The book.
pub(super) struct Book {
    held: Held,
    task: &'static str,
    book: book::Book<i64>,
}

impl Book {
    pub(super) fn new(
        held: Held,
        task: &'static str,
        assigned: Assigned,
        shape: Shape,
        autoreset: Autoreset,
    ) -> Self {
        Self { held, task, book: book::Book::new(assigned, shape, autoreset) }
    }

    /// Decides what is begun next, in a reset of all or some (`reset`) or in a step.
    pub(super) fn assign(&mut self, reset: Option<Option<&[bool]>>) {
        let mut pool = Pool { lease: lock(&self.held), task: self.task };
        // Who finds nothing rests.
        let _ = self.book.assign(&mut pool, reset);
    }

    /// What was flown by those that are reset before their end is given back.
    pub(super) fn give_up(&mut self, mask: Option<&[bool]>) {
        let mut pool = Pool { lease: lock(&self.held), task: self.task };
        self.book.give_up(&mut pool, mask);
    }

    /// Those that were reset fly what was assigned to them.
    pub(super) fn began(&mut self, mask: Option<&[bool]>) {
        self.book.began(mask);
    }

    /// A step was taken with these actions, earned so much, and ended these episodes.
    pub(super) fn stepped(&mut self, actions: &[f32], team_rewards: &[f32], done: &[bool]) {
        self.book.stepped(actions, team_rewards, done);
    }

    /// What was flown to its end since this was asked last.
    pub(super) fn finished(&mut self) -> Vec<Claim> {
        let finished = self.book.finished();
        if finished.is_empty() {
            return Vec::new();
        }
        let lease = lock(&self.held).lease.clone();
        let claim = |flown: book::Flown<i64>| Claim {
            episode: EpisodeId { lease: lease.clone(), index: flown.name }.to_string(),
            what: Claimed::Logged(flown.tape.log()),
            policy_version: None,
            metrics: None,
        };
        finished.into_iter().map(claim).collect()
    }

    /// The index in the lease of what each slot flies; −1 where it flies nothing.
    pub(super) fn episodes(&self) -> impl Iterator<Item = i32> {
        self.book.flying().map(|flown| flown.and_then(|flown| i32::try_from(flown.name).ok()).unwrap_or(-1))
    }
}

impl Drop for Book {
    fn drop(&mut self) {
        let mut pool = Pool { lease: lock(&self.held), task: self.task };
        self.book.close(&mut pool);
    }
}
