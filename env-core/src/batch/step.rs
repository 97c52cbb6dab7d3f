//! One step of a batch: the lanes of a chunk, and the sequence of episodes in each slot.

use std::cell::Cell;

use super::lane::{BatchLane, LaneStep};
use super::rows::{Row, Rows, StepRow};
use super::{Autoreset, BatchError, BatchShape, MAX_UNFAIR_STARTS, ScenarioSource};
use crate::error::ScenarioError;
use crate::task::Scenario;

/// A lane with the sequence of its episodes.
pub(super) struct Slot<L> {
    pub(super) lane: L,
    pub(super) sequence: EpisodeSequence,
}

/// The episodes of a slot.
pub(super) struct EpisodeSequence {
    pub(super) index: usize,
    /// Number of scenarios started or skipped.
    pub(super) next_number: u64,
    pub(super) scenario: Option<Scenario>,
    pub(super) done: bool,
    /// True if the source had no scenario to start.
    pub(super) idle: bool,
}

impl EpisodeSequence {
    /// Starts the next scenario of the slot, skipping those without a fair start. Without a scenario it becomes idle.
    pub(super) fn restart(
        &mut self,
        lane: &mut impl BatchLane,
        source: &dyn ScenarioSource,
    ) -> Result<(), BatchError> {
        self.done = true;
        self.idle = !source.has_scenario(self.index);
        if self.idle {
            self.scenario = None;
            return Ok(());
        }
        let mut skipped = 0;
        loop {
            let scenario = source.scenario(self.index, self.next_number);
            self.next_number += 1;
            match lane.start(&scenario) {
                Ok(()) => {
                    self.scenario = Some(scenario);
                    self.done = false;
                    return Ok(());
                }
                Err(ScenarioError::Unfair { .. }) if skipped < MAX_UNFAIR_STARTS => skipped += 1,
                Err(source) => return Err(BatchError::Scenario { env: self.index, source }),
            }
        }
    }

    /// What follows the step of a lane: the end of an episode, and the observation.
    fn finish_step(
        &mut self,
        lane: &mut impl BatchLane,
        done: bool,
        step: &BatchStep<'_>,
        row: StepRow<'_>,
    ) -> Result<(), BatchError> {
        self.done = done;
        let StepRow { observation, final_observation, done: is_over, needs_action } = row;
        *is_over = done;
        if done && step.autoreset == Autoreset::SameStep {
            lane.observe(final_observation);
            self.restart(lane, step.source)?;
        }
        self.observe(lane, observation);
        self.needs_action(lane, needs_action);
        Ok(())
    }

    /// A step without an episode: under [`Autoreset::NextStep`] it is the reset, otherwise the slot is idle.
    fn step_after_end(
        &mut self,
        lane: &mut impl BatchLane,
        step: &BatchStep<'_>,
        row: Row<'_>,
    ) -> Result<(), BatchError> {
        let (out, row) = row.split();
        out.rewards.fill(0.0);
        *out.team_reward = 0.0;
        out.truncated.fill(false);
        out.elapsed.fill(0.0);
        out.executed_actions.fill(step.hold);
        *row.done = false;
        if step.autoreset != Autoreset::Disabled {
            self.restart(lane, step.source)?;
        }
        self.observe(lane, row.observation);
        if self.idle {
            out.terminated.fill(true);
        } else {
            lane.mark_absent_agents(out.terminated);
        }
        self.needs_action(lane, row.needs_action);
        Ok(())
    }

    /// Writes which agents need an action; none if the slot is idle.
    pub(super) fn needs_action(&self, lane: &impl BatchLane, out: &mut [bool]) {
        if self.idle { out.fill(false) } else { lane.needs_action(out) }
    }

    /// Writes the current observation; zeros if the slot is idle.
    pub(super) fn observe(&self, lane: &mut impl BatchLane, out: &mut [f32]) {
        if self.idle { out.fill(0.0) } else { lane.observe(out) }
    }
}

/// One step of all slots.
#[derive(Clone, Copy)]
pub(super) struct BatchStep<'a> {
    pub(super) source: &'a dyn ScenarioSource,
    pub(super) autoreset: Autoreset,
    pub(super) shape: BatchShape,
    pub(super) hold: f32,
    /// Environments to step; all without a mask.
    pub(super) mask: Option<&'a [bool]>,
    pub(super) chunk_len: usize,
}

impl BatchStep<'_> {
    /// Halves the slots until they fit one chunk, and steps the chunks in parallel without allocating.
    pub(super) fn run<L: BatchLane>(
        self,
        slots: &mut [Slot<L>],
        actions: &[f32],
        mut rows: Rows<'_>,
    ) -> Result<(), BatchError> {
        let width = self.shape.agents * self.shape.action;
        if slots.len() <= self.chunk_len {
            return self.run_chunk(slots, actions.chunks_exact(width).zip(rows.rows(self.shape)));
        }
        let half = slots.len() / 2;
        let (slots, other_slots) = slots.split_at_mut(half);
        let (actions, other_actions) = actions.split_at(half * width);
        let head = rows.take_envs(half, self.shape);
        let (a, b) =
            rayon::join(|| self.run(slots, actions, head), || self.run(other_slots, other_actions, rows));
        a.and(b)
    }

    /// Steps the slots of a chunk. An error of one slot does not stop the others: which slots advance must not depend on chunks.
    fn run_chunk<'a, L: BatchLane>(
        &self,
        slots: &'a mut [Slot<L>],
        inputs: impl Iterator<Item = (&'a [f32], Row<'a>)>,
    ) -> Result<(), BatchError> {
        let first = FirstError::default();
        let running = slots.iter_mut().zip(inputs).filter_map(|(slot, (actions, row))| {
            let Slot { lane, sequence } = slot;
            if self.mask.is_some_and(|mask| !mask[sequence.index]) {
                return None;
            }
            if sequence.done {
                first.note(sequence.index, sequence.step_after_end(lane, self, row));
                return None;
            }
            let (out, row) = row.split();
            Some((LaneStep { lane, actions, out }, (sequence, row)))
        });
        L::step_many(running, |lane, done, (sequence, row)| {
            first.note(sequence.index, sequence.finish_step(lane, done, self, row));
        });
        first.result()
    }
}

/// The error of the lowest slot.
#[derive(Default)]
struct FirstError(Cell<Option<(usize, BatchError)>>);

impl FirstError {
    /// Keeps an error if it is that of a lower slot than the one before.
    fn note(&self, slot: usize, result: Result<(), BatchError>) {
        if let Err(error) = result {
            let before = self.0.take();
            self.0.set(Some(before.filter(|(other, _)| *other < slot).unwrap_or((slot, error))));
        }
    }

    fn result(self) -> Result<(), BatchError> {
        self.0.into_inner().map_or(Ok(()), |(_, error)| Err(error))
    }
}
