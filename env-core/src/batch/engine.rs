//! The batch engine: steps lanes side by side.

use rayon::prelude::*;
use serde_json::Value;

use super::buffers::LaneOutput;
use super::rows::{Row, Rows};
use super::{
    Autoreset, Batch, BatchConfig, BatchError, BatchOutput, BatchShape, MAX_ENVS, MAX_UNFAIR_STARTS,
    ObservationPart, RunningEpisode, ScenarioSource,
};
use crate::error::ScenarioError;
use crate::scene::Scene;
use crate::task::Scenario;

/// Smallest number of environments that are shared among threads. Handing over a chunk costs microseconds.
const MIN_SHARED_ENVS: usize = 64;
/// Number of chunks per thread, so that a slow or delayed thread leaves little work at the end.
const CHUNKS_PER_THREAD: usize = 16;
/// Smallest number of environments of a chunk.
const MIN_CHUNK_ENVS: usize = 16;

/// One environment of a world in a batch.
pub trait BatchLane: Send + Sized {
    /// Starts an episode of a scenario in the same memory.
    ///
    /// # Errors
    /// Returns an error if the scenario cannot start.
    fn start(&mut self, scenario: &Scenario) -> Result<(), ScenarioError>;

    /// Advances an episode that is not over by one step, and returns true if it is then over. `actions` is
    /// `agents × action`, all finite.
    fn step(&mut self, actions: &[f32], out: LaneOutput<'_>) -> bool;

    /// Marks the agents of the batch that are absent from a new episode as terminated, and clears the others.
    fn mark_absent_agents(&self, terminated: &mut [bool]) {
        terminated.fill(false);
    }

    /// Writes the current observation.
    fn observe(&mut self, out: &mut [f32]);

    /// Score of the episode so far.
    fn score(&self) -> f64;

    /// A digest of every bit of the state.
    fn state_hash(&self) -> [u8; 32];

    /// Scene after a step with these actions.
    fn scene(&self, actions: &[f32]) -> Scene;

    /// Texts of the events of the last step.
    fn alerts(&self) -> Vec<String>;

    /// Observation of the agents as JSON.
    fn telemetry(&self) -> Value;

    /// Names of the values that [`BatchLane::observe`] writes, in order.
    fn columns(&self) -> Vec<String>;

    /// Arrays that [`BatchLane::observe`] writes, in order.
    fn parts(&self) -> Vec<ObservationPart>;

    /// Memory of the lane, in bytes.
    fn bytes(&self) -> usize;
}

/// A batch of one world's lanes.
pub struct BatchEngine<L> {
    slots: Vec<Slot<L>>,
    source: Box<dyn ScenarioSource>,
    autoreset: Autoreset,
    shape: BatchShape,
    single_threaded: bool,
}

/// A lane and the state of its episodes.
struct Slot<L> {
    lane: L,
    index: usize,
    /// Number of scenarios started or skipped.
    next_number: u64,
    scenario: Option<Scenario>,
    done: bool,
    /// True if the source had no scenario to start.
    idle: bool,
}

impl<L: BatchLane> BatchEngine<L> {
    /// Creates a batch of lanes from `create_lane`. No lane has an episode before the first reset.
    ///
    /// # Errors
    /// Returns [`BatchError::Config`] if the number of environments is not within 1 to [`MAX_ENVS`].
    pub fn new(
        config: BatchConfig,
        shape: BatchShape,
        source: Box<dyn ScenarioSource>,
        mut create_lane: impl FnMut() -> L,
    ) -> Result<Self, BatchError> {
        if config.envs == 0 || config.envs > MAX_ENVS {
            return Err(BatchError::Config { field: "envs", value: config.envs, min: 1, max: MAX_ENVS });
        }
        let slot = |index| Slot {
            lane: create_lane(),
            index,
            next_number: 0,
            scenario: None,
            done: true,
            idle: false,
        };
        let slots = (0..config.envs).map(slot).collect();
        let BatchConfig { autoreset, single_threaded, .. } = config;
        Ok(Self { slots, source, autoreset, shape, single_threaded })
    }

    /// Number of environments of a chunk.
    fn chunk_len(&self) -> usize {
        let envs = self.shape.envs;
        // Asking rayon for its number of threads creates its global pool, so it is asked only if needed.
        if self.single_threaded || envs < MIN_SHARED_ENVS {
            return envs;
        }
        match rayon::current_num_threads() {
            1 => envs,
            threads => envs.div_ceil(threads * CHUNKS_PER_THREAD).max(MIN_CHUNK_ENVS),
        }
    }

    /// Applies `act` to every slot and its row of observations. Returns the first error after all are done.
    fn for_each_slot(
        &mut self,
        observations: &mut [f32],
        act: impl Fn(&dyn ScenarioSource, &mut Slot<L>, &mut [f32]) -> Result<(), BatchError> + Sync,
    ) -> Result<(), BatchError> {
        let BatchShape { envs, observation, .. } = self.shape;
        check_size("observations", observations.len(), envs * observation)?;
        let chunk_len = self.chunk_len();
        let (width, source) = (observation.max(1), &*self.source);
        let act_on_chunk = |(slots, rows): (&mut [Slot<L>], &mut [f32])| {
            let mut first = Ok(());
            for (slot, row) in slots.iter_mut().zip(rows.chunks_exact_mut(width)) {
                let result = act(source, slot, row);
                first = first.and(result);
            }
            first
        };
        if chunk_len == envs {
            // The calling thread does it alone, without waking a pool.
            return act_on_chunk((&mut self.slots, observations));
        }
        let rows = observations.par_chunks_mut(chunk_len * width);
        self.slots.par_chunks_mut(chunk_len).zip(rows).map(act_on_chunk).reduce(|| Ok(()), Result::and)
    }

    /// Checks everything that could be wrong with a step before anything changes.
    fn check_step(&self, actions: &[f32], out: &BatchOutput<'_>) -> Result<(), BatchError> {
        let BatchShape { envs, agents, action, observation } = self.shape;
        let finals = if self.autoreset == Autoreset::SameStep { envs * observation } else { 0 };
        let executed = if out.executed_actions.is_empty() { 0 } else { actions.len() };
        check_size("actions", actions.len(), envs * agents * action)?;
        check_size("observations", out.observations.len(), envs * observation)?;
        check_size("final_observations", out.final_observations.len(), finals)?;
        check_size("rewards", out.rewards.len(), envs * agents)?;
        check_size("team_rewards", out.team_rewards.len(), envs)?;
        check_size("terminated", out.terminated.len(), envs * agents)?;
        check_size("truncated", out.truncated.len(), envs * agents)?;
        check_size("done", out.done.len(), envs)?;
        check_size("taken", out.executed_actions.len(), executed)?;
        // 0·x is 0 for every finite x and NaN for the others, so the sum is 0 exactly if all actions are finite.
        let sum: f32 = actions.iter().map(|x| x * 0.0).sum();
        if sum != 0.0
            && let Some(at) = actions.iter().position(|x| !x.is_finite())
        {
            return Err(BatchError::NotFinite { env: at / (agents * action), agent: at / action % agents });
        }
        let can_step = |slot: &Slot<L>| {
            !slot.done || slot.idle || (self.autoreset == Autoreset::NextStep && slot.next_number > 0)
        };
        match self.slots.iter().position(|slot| !can_step(slot)) {
            Some(env) => Err(BatchError::Ended { env }),
            None => Ok(()),
        }
    }
}

impl<L: BatchLane> Batch for BatchEngine<L> {
    fn shape(&self) -> BatchShape {
        self.shape
    }

    fn reset(&mut self, mask: Option<&[bool]>, observations: &mut [f32]) -> Result<(), BatchError> {
        let envs = self.shape.envs;
        check_size("mask", mask.map_or(envs, <[bool]>::len), envs)?;
        self.for_each_slot(observations, |source, slot, row| {
            if mask.is_none_or(|mask| mask[slot.index]) {
                slot.restart(source)?;
                slot.observe(row);
            }
            Ok(())
        })
    }

    fn observe(&mut self, observations: &mut [f32]) -> Result<(), BatchError> {
        self.for_each_slot(observations, |_, slot, row| {
            slot.observe(row);
            Ok(())
        })
    }

    fn step(&mut self, actions: &[f32], out: BatchOutput<'_>) -> Result<(), BatchError> {
        self.check_step(actions, &out)?;
        let (shape, autoreset, source) = (self.shape, self.autoreset, &*self.source);
        let step = BatchStep { source, autoreset, shape, chunk_len: self.chunk_len() };
        step.run(&mut self.slots, actions, Rows::from(out))
    }

    fn running_episode(&self, env: usize) -> Option<RunningEpisode> {
        let slot = self.slots.get(env)?;
        let scenario = slot.scenario.clone()?;
        Some(RunningEpisode { scenario, score: slot.lane.score() })
    }

    fn state_hash(&self, env: usize) -> Option<[u8; 32]> {
        self.slots.get(env).map(|slot| slot.lane.state_hash())
    }

    fn scene(&self, env: usize, actions: &[f32]) -> Option<Scene> {
        let slot = self.slots.get(env)?;
        slot.scenario.as_ref().map(|_| slot.lane.scene(actions))
    }

    fn telemetry(&self, env: usize) -> Option<Value> {
        let slot = self.slots.get(env)?;
        slot.scenario.as_ref().map(|_| slot.lane.telemetry())
    }

    fn alerts(&self, env: usize) -> Vec<String> {
        self.slots.get(env).map(|slot| slot.lane.alerts()).unwrap_or_default()
    }

    fn mark_absent_agents(&self, env: usize, terminated: &mut [bool]) {
        match self.slots.get(env) {
            Some(slot) if !slot.idle => slot.lane.mark_absent_agents(terminated),
            _ => terminated.fill(true),
        }
    }

    fn is_idle(&self, env: usize) -> bool {
        self.slots.get(env).is_some_and(|slot| slot.idle)
    }

    fn columns(&self) -> Vec<String> {
        self.slots.first().map(|slot| slot.lane.columns()).unwrap_or_default()
    }

    fn parts(&self) -> Vec<ObservationPart> {
        self.slots.first().map(|slot| slot.lane.parts()).unwrap_or_default()
    }

    fn bytes_per_env(&self) -> usize {
        let lanes: usize = self.slots.iter().map(|slot| slot.lane.bytes() + size_of::<Slot<L>>()).sum();
        lanes / self.slots.len().max(1)
    }
}

impl<L: BatchLane> Slot<L> {
    /// Starts the next scenario of the slot, skipping those without a fair start. Without a scenario it becomes idle.
    fn restart(&mut self, source: &dyn ScenarioSource) -> Result<(), BatchError> {
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
            match self.lane.start(&scenario) {
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

    fn step(
        &mut self,
        source: &dyn ScenarioSource,
        autoreset: Autoreset,
        actions: &[f32],
        row: Row<'_>,
    ) -> Result<(), BatchError> {
        if self.done {
            return self.step_after_end(source, autoreset, row);
        }
        let Row {
            observation,
            final_observation,
            rewards,
            team_reward,
            terminated,
            truncated,
            done,
            executed_actions,
        } = row;
        let out = LaneOutput { rewards, team_reward, terminated, truncated, executed_actions };
        self.done = self.lane.step(actions, out);
        *done = self.done;
        if self.done && autoreset == Autoreset::SameStep {
            self.lane.observe(final_observation);
            self.restart(source)?;
        }
        self.observe(observation);
        Ok(())
    }

    /// A step without an episode: under [`Autoreset::NextStep`] it is the reset, otherwise the slot is idle.
    fn step_after_end(
        &mut self,
        source: &dyn ScenarioSource,
        autoreset: Autoreset,
        row: Row<'_>,
    ) -> Result<(), BatchError> {
        let Row { observation, rewards, team_reward, terminated, truncated, done, executed_actions, .. } =
            row;
        rewards.fill(0.0);
        *team_reward = 0.0;
        truncated.fill(false);
        executed_actions.fill(0.0);
        *done = false;
        if autoreset != Autoreset::Disabled {
            self.restart(source)?;
        }
        self.observe(observation);
        if self.idle {
            terminated.fill(true);
        } else {
            self.lane.mark_absent_agents(terminated);
        }
        Ok(())
    }

    fn observe(&mut self, out: &mut [f32]) {
        if self.idle { out.fill(0.0) } else { self.lane.observe(out) }
    }
}

/// One step of all slots.
#[derive(Clone, Copy)]
struct BatchStep<'a> {
    source: &'a dyn ScenarioSource,
    autoreset: Autoreset,
    shape: BatchShape,
    chunk_len: usize,
}

impl BatchStep<'_> {
    /// Halves the slots until they fit one chunk, and steps the chunks in parallel without allocating.
    fn run<L: BatchLane>(
        self,
        slots: &mut [Slot<L>],
        actions: &[f32],
        mut rows: Rows<'_>,
    ) -> Result<(), BatchError> {
        let width = self.shape.agents * self.shape.action;
        if slots.len() <= self.chunk_len {
            // An error of one slot does not stop the others: which slots advance must not depend on chunks.
            let mut first = Ok(());
            let inputs = actions.chunks_exact(width).zip(rows.rows(self.shape));
            for (slot, (actions, row)) in slots.iter_mut().zip(inputs) {
                let result = slot.step(self.source, self.autoreset, actions, row);
                first = first.and(result);
            }
            return first;
        }
        let half = slots.len() / 2;
        let (slots, other_slots) = slots.split_at_mut(half);
        let (actions, other_actions) = actions.split_at(half * width);
        let head = rows.take_envs(half, self.shape);
        let (a, b) =
            rayon::join(|| self.run(slots, actions, head), || self.run(other_slots, other_actions, rows));
        a.and(b)
    }
}

fn check_size(buffer: &'static str, found: usize, wanted: usize) -> Result<(), BatchError> {
    if found == wanted { Ok(()) } else { Err(BatchError::Size { buffer, found, wanted }) }
}
