//! The batch engine: steps lanes side by side.

use rayon::prelude::*;
use serde_json::Value;

use super::lane::BatchLane;
use super::rows::Rows;
use super::step::{BatchStep, EpisodeSequence, Slot};
use super::{
    Autoreset, Batch, BatchConfig, BatchError, BatchOutput, BatchShape, MAX_ENVS, ObservationPart,
    RunningEpisode, ScenarioSource,
};
use crate::scene::Scene;
use crate::space::{ActionKind, ActionSpace};

/// Smallest number of environments that are shared among threads. Handing over a chunk costs microseconds.
const MIN_SHARED_ENVS: usize = 64;
/// Number of chunks per thread, so that a slow or delayed thread leaves little work at the end.
const CHUNKS_PER_THREAD: usize = 16;
/// Smallest number of environments of a chunk.
const MIN_CHUNK_ENVS: usize = 16;

/// A batch of one world's lanes.
pub struct BatchEngine<L> {
    slots: Vec<Slot<L>>,
    source: Box<dyn ScenarioSource>,
    autoreset: Autoreset,
    shape: BatchShape,
    actions: ActionSpace,
    single_threaded: bool,
}

impl<L: BatchLane> BatchEngine<L> {
    /// Creates a batch of lanes from `create_lane`. No lane has an episode before the first reset.
    ///
    /// # Errors
    /// Returns [`BatchError::Config`] if the number of environments is not within 1 to [`MAX_ENVS`].
    pub fn new(
        config: BatchConfig,
        shape: BatchShape,
        actions: ActionSpace,
        source: Box<dyn ScenarioSource>,
        mut create_lane: impl FnMut() -> L,
    ) -> Result<Self, BatchError> {
        if config.envs == 0 || config.envs > MAX_ENVS {
            return Err(BatchError::Config { field: "envs", value: config.envs, min: 1, max: MAX_ENVS });
        }
        let slot = |index| Slot {
            lane: create_lane(),
            sequence: EpisodeSequence { index, next_number: 0, scenario: None, done: true, idle: false },
        };
        let slots = (0..config.envs).map(slot).collect();
        let BatchConfig { autoreset, single_threaded, .. } = config;
        Ok(Self { slots, source, autoreset, shape, actions, single_threaded })
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
    fn check_step(
        &self,
        actions: &[f32],
        mask: Option<&[bool]>,
        out: &BatchOutput<'_>,
    ) -> Result<(), BatchError> {
        let BatchShape { envs, agents, action, observation } = self.shape;
        let finals = if self.autoreset == Autoreset::SameStep { envs * observation } else { 0 };
        let executed = if out.executed_actions.is_empty() { 0 } else { actions.len() };
        check_size("actions", actions.len(), envs * agents * action)?;
        check_size("mask", mask.map_or(envs, <[bool]>::len), envs)?;
        check_size("observations", out.observations.len(), envs * observation)?;
        check_size("final_observations", out.final_observations.len(), finals)?;
        check_size("rewards", out.rewards.len(), envs * agents)?;
        check_size("team_rewards", out.team_rewards.len(), envs)?;
        check_size("terminated", out.terminated.len(), envs * agents)?;
        check_size("truncated", out.truncated.len(), envs * agents)?;
        check_size("done", out.done.len(), envs)?;
        check_size("elapsed", out.elapsed.len(), if out.elapsed.is_empty() { 0 } else { envs })?;
        let wanted = if out.needs_action.is_empty() { 0 } else { envs * agents };
        check_size("needs_action", out.needs_action.len(), wanted)?;
        check_size("taken", out.executed_actions.len(), executed)?;
        self.check_actions(actions)?;
        let can_step = |slot: &EpisodeSequence| {
            let is_masked = mask.is_some_and(|mask| !mask[slot.index]);
            let may_restart = self.autoreset == Autoreset::NextStep && slot.next_number > 0;
            !slot.done || slot.idle || may_restart || is_masked
        };
        match self.slots.iter().position(|slot| !can_step(&slot.sequence)) {
            Some(env) => Err(BatchError::Ended { env }),
            None => Ok(()),
        }
    }

    /// Checks that the action space accepts all values.
    fn check_actions(&self, actions: &[f32]) -> Result<(), BatchError> {
        let BatchShape { agents, action, .. } = self.shape;
        if self.actions.kind == ActionKind::Box {
            // 0·x is 0 for every finite x and NaN for the others, so the sum is 0 exactly if all actions are finite.
            let sum: f32 = actions.iter().map(|x| x * 0.0).sum();
            if sum == 0.0 {
                return Ok(());
            }
        }
        let Some(at) = actions.iter().position(|value| !self.actions.accepts(*value)) else { return Ok(()) };
        let (env, agent) = (at / (agents * action), at / action % agents);
        Err(match self.actions.kind {
            ActionKind::Box => BatchError::NotFinite { env, agent },
            ActionKind::Discrete { names } => {
                BatchError::UnknownAction { env, agent, value: actions[at], last: names.len() - 1 }
            }
        })
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
            if mask.is_none_or(|mask| mask[slot.sequence.index]) {
                slot.sequence.restart(&mut slot.lane, source)?;
                slot.sequence.observe(&mut slot.lane, row);
            }
            Ok(())
        })
    }

    fn observe(&mut self, observations: &mut [f32]) -> Result<(), BatchError> {
        self.for_each_slot(observations, |_, slot, row| {
            slot.sequence.observe(&mut slot.lane, row);
            Ok(())
        })
    }

    fn step_some(
        &mut self,
        actions: &[f32],
        mask: Option<&[bool]>,
        out: BatchOutput<'_>,
    ) -> Result<(), BatchError> {
        self.check_step(actions, mask, &out)?;
        let (shape, autoreset, source) = (self.shape, self.autoreset, &*self.source);
        let hold = self.actions.hold;
        let step = BatchStep { source, autoreset, shape, hold, mask, chunk_len: self.chunk_len() };
        step.run(&mut self.slots, actions, Rows::from(out))
    }

    fn running_episode(&self, env: usize) -> Option<RunningEpisode> {
        let slot = self.slots.get(env)?;
        let scenario = slot.sequence.scenario.clone()?;
        Some(RunningEpisode { scenario, score: slot.lane.score() })
    }

    fn state_hash(&self, env: usize) -> Option<[u8; 32]> {
        self.slots.get(env).map(|slot| slot.lane.state_hash())
    }

    fn scene(&self, env: usize, actions: &[f32]) -> Option<Scene> {
        let slot = self.slots.get(env)?;
        slot.sequence.scenario.as_ref().map(|_| slot.lane.scene(actions))
    }

    fn telemetry(&self, env: usize) -> Option<Value> {
        let slot = self.slots.get(env)?;
        slot.sequence.scenario.as_ref().map(|_| slot.lane.telemetry())
    }

    fn alerts(&self, env: usize) -> Vec<String> {
        self.slots.get(env).map(|slot| slot.lane.alerts()).unwrap_or_default()
    }

    fn mark_absent_agents(&self, env: usize, terminated: &mut [bool]) {
        match self.slots.get(env) {
            Some(slot) if !slot.sequence.idle => slot.lane.mark_absent_agents(terminated),
            _ => terminated.fill(true),
        }
    }

    fn write_needs_action(&self, env: usize, needs_action: &mut [bool]) {
        match self.slots.get(env) {
            Some(slot) => slot.sequence.needs_action(&slot.lane, needs_action),
            None => needs_action.fill(false),
        }
    }

    fn is_idle(&self, env: usize) -> bool {
        self.slots.get(env).is_some_and(|slot| slot.sequence.idle)
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

fn check_size(buffer: &'static str, found: usize, wanted: usize) -> Result<(), BatchError> {
    if found == wanted { Ok(()) } else { Err(BatchError::Size { buffer, found, wanted }) }
}
