//! Lanes stepped side by side.

use std::sync::Arc;

use rayon::prelude::*;
use serde_json::Value;

use super::rows::{Row, Rows};
use super::{Autoreset, Batch, BatchConfig, BatchError, Feed, MAX_ENVS, MAX_UNFAIR, Output, Shape};
use crate::error::ScenarioError;
use crate::scenario::{Recipe, Scenario};
use crate::scene::Scene;
use crate::seed::Seed;

/// Environments below which a batch is stepped by the calling thread alone: handing a chunk over costs microseconds.
const WORTH_SHARING: usize = 64;
/// Chunks a thread gets, so that whoever is late, or held up, leaves little undone at the end.
const CHUNKS_PER_THREAD: usize = 16;
/// Environments of a chunk, at least.
const LEAST: usize = 16;

/// One environment of a world, as a batch steps it.
pub trait Lane: Send + Sized {
    /// Starts over with this scenario, in the same memory.
    ///
    /// # Errors
    /// A scenario that cannot start.
    fn start(&mut self, recipe: &Arc<Recipe>, seed: Seed) -> Result<(), ScenarioError>;
    /// One step of an episode that is not over. `actions` is `agents × action`, all finite. True if the episode is over.
    fn step(&mut self, actions: &[f32], out: LaneOutput<'_>) -> bool;
    /// Says which of the batch's agents an episode that has just started is without, where that can be.
    fn absent(&self, terminated: &mut [bool]) {
        terminated.fill(false);
    }
    /// Writes what is seen now.
    fn observe(&mut self, out: &mut [f32]);
    /// The sum of rewards, as the world's score has it.
    fn score(&self) -> f64;
    /// A digest of every bit of the state.
    fn state_hash(&self) -> [u8; 32];
    /// What it looks like after these actions.
    fn scene(&self, acted: &[f32]) -> Scene;
    /// What happened in the last step, in words.
    fn alerts(&self) -> Vec<String>;
    /// What is seen, in the wire form.
    fn telemetry(&self) -> Value;
    /// What the values that [`Lane::observe`] writes are called, in order.
    fn columns(&self) -> Vec<String>;
    /// Bytes it takes.
    fn bytes(&self) -> usize;
}

/// What a lane writes in a step.
#[derive(Debug)]
pub struct LaneOutput<'a> {
    /// One a agent.
    pub rewards: &'a mut [f32],
    /// The team's.
    pub team_reward: &'a mut f32,
    /// One a agent: it has left, now or earlier.
    pub terminated: &'a mut [bool],
    /// One a agent: the horizon cut it off, now.
    pub truncated: &'a mut [bool],
    /// What the agents did, along the world's axes; empty where nobody wants to know.
    pub taken: &'a mut [f32],
}

/// A lane in its slot.
struct Seat<L> {
    lane: L,
    slot: usize,
    /// Scenarios begun or passed over.
    number: u64,
    flies: Option<(Arc<Recipe>, Seed)>,
    over: bool,
    /// There was no scenario to begin.
    rests: bool,
}

/// A batch of one world's lanes.
pub struct Engine<L> {
    seats: Vec<Seat<L>>,
    feed: Box<dyn Feed>,
    autoreset: Autoreset,
    shape: Shape,
    alone: bool,
}

impl<L: Lane> Engine<L> {
    /// Lanes made by `lane`, all yet to be reset.
    ///
    /// # Errors
    /// No environments, or too many.
    pub fn new(
        config: BatchConfig,
        shape: Shape,
        feed: Box<dyn Feed>,
        mut lane: impl FnMut() -> L,
    ) -> Result<Self, BatchError> {
        if config.envs == 0 || config.envs > MAX_ENVS {
            return Err(BatchError::Config { field: "envs", value: config.envs, min: 1, max: MAX_ENVS });
        }
        let seat = |slot| Seat { lane: lane(), slot, number: 0, flies: None, over: true, rests: false };
        let seats = (0..config.envs).map(seat).collect();
        Ok(Self { seats, feed, autoreset: config.autoreset, shape, alone: config.alone })
    }

    fn chunk(&self) -> usize {
        let envs = self.shape.envs;
        // Asking rayon how many threads there are makes its global pool where there is none.
        if self.alone || envs < WORTH_SHARING {
            return envs;
        }
        match rayon::current_num_threads() {
            1 => envs,
            threads => envs.div_ceil(threads * CHUNKS_PER_THREAD).max(LEAST),
        }
    }

    /// Does something to every seat and its row of observations, and tells the first error once all are done.
    fn each(
        &mut self,
        observations: &mut [f32],
        act: impl Fn(&dyn Feed, &mut Seat<L>, &mut [f32]) -> Result<(), BatchError> + Sync,
    ) -> Result<(), BatchError> {
        let Shape { envs, observation, .. } = self.shape;
        if observations.len() != envs * observation {
            let (found, wanted) = (observations.len(), envs * observation);
            return Err(BatchError::Size { buffer: "observations", found, wanted });
        }
        let chunk = self.chunk();
        let (width, feed) = (observation.max(1), &*self.feed);
        let all = |(seats, rows): (&mut [Seat<L>], &mut [f32])| {
            let mut first = Ok(());
            for (seat, row) in seats.iter_mut().zip(rows.chunks_exact_mut(width)) {
                let acted = act(feed, seat, row);
                first = first.and(acted);
            }
            first
        };
        if chunk == envs {
            // By the calling thread: a pool is not woken for what it would do alone.
            return all((&mut self.seats, observations));
        }
        let rows = observations.par_chunks_mut(chunk * width);
        self.seats.par_chunks_mut(chunk).zip(rows).map(all).reduce(|| Ok(()), Result::and)
    }

    /// Everything that could be wrong, before anything moves.
    fn check(&self, actions: &[f32], out: &Output<'_>) -> Result<(), BatchError> {
        let Shape { envs, agents, action, observation } = self.shape;
        let finals = if self.autoreset == Autoreset::SameStep { envs * observation } else { 0 };
        let sizes = [
            ("actions", actions.len(), envs * agents * action),
            ("observations", out.observations.len(), envs * observation),
            ("final_observations", out.final_observations.len(), finals),
            ("rewards", out.rewards.len(), envs * agents),
            ("team_rewards", out.team_rewards.len(), envs),
            ("terminated", out.terminated.len(), envs * agents),
            ("truncated", out.truncated.len(), envs * agents),
            ("done", out.done.len(), envs),
            ("taken", out.taken.len(), if out.taken.is_empty() { 0 } else { actions.len() }),
        ];
        for (buffer, found, wanted) in sizes {
            if found != wanted {
                return Err(BatchError::Size { buffer, found, wanted });
            }
        }
        // A sum is finite only if every term is, or terms cancel: 0·x is 0 for every finite x and NaN for the others.
        let sum: f32 = actions.iter().map(|x| x * 0.0).sum();
        if sum != 0.0
            && let Some(at) = actions.iter().position(|x| !x.is_finite())
        {
            return Err(BatchError::NotFinite { env: at / (agents * action), agent: at / action % agents });
        }
        let may_step = |seat: &Seat<L>| {
            !seat.over || seat.rests || (self.autoreset == Autoreset::NextStep && seat.number > 0)
        };
        match self.seats.iter().position(|seat| !may_step(seat)) {
            Some(env) => Err(BatchError::Ended { env }),
            None => Ok(()),
        }
    }
}

impl<L: Lane> Seat<L> {
    /// The slot's next scenario; those without a fair start are passed over. Where there is none it rests.
    fn restart(&mut self, feed: &dyn Feed) -> Result<(), BatchError> {
        self.over = true;
        self.rests = !feed.has(self.slot);
        if self.rests {
            self.flies = None;
            return Ok(());
        }
        let mut passed_over = 0;
        loop {
            let (recipe, seed) = feed.scenario(self.slot, self.number);
            self.number += 1;
            match self.lane.start(&recipe, seed) {
                Ok(()) => {
                    self.flies = Some((recipe, seed));
                    self.over = false;
                    return Ok(());
                }
                Err(ScenarioError::Unfair { .. }) if passed_over < MAX_UNFAIR => passed_over += 1,
                Err(source) => return Err(BatchError::Scenario { env: self.slot, source }),
            }
        }
    }

    fn step(
        &mut self,
        feed: &dyn Feed,
        autoreset: Autoreset,
        actions: &[f32],
        row: Row<'_>,
    ) -> Result<(), BatchError> {
        if self.over {
            // Under NextStep this step is the reset; else the slot rests.
            row.rewards.fill(0.0);
            *row.team_reward = 0.0;
            row.truncated.fill(false);
            row.taken.fill(0.0);
            *row.done = false;
            if autoreset != Autoreset::Disabled {
                self.restart(feed)?;
            }
            self.observe(row.observation);
            if self.rests {
                row.terminated.fill(true);
            } else {
                self.lane.absent(row.terminated);
            }
            return Ok(());
        }
        let Row { observation, last, rewards, team_reward, terminated, truncated, done, taken } = row;
        self.over =
            self.lane.step(actions, LaneOutput { rewards, team_reward, terminated, truncated, taken });
        *done = self.over;
        if self.over && autoreset == Autoreset::SameStep {
            self.lane.observe(last);
            self.restart(feed)?;
        }
        self.observe(observation);
        Ok(())
    }

    fn observe(&mut self, out: &mut [f32]) {
        if self.rests { out.fill(0.0) } else { self.lane.observe(out) }
    }
}

/// One step of all seats.
#[derive(Clone, Copy)]
struct Flight<'a> {
    feed: &'a dyn Feed,
    autoreset: Autoreset,
    shape: Shape,
    chunk: usize,
}

impl Flight<'_> {
    /// Halves the seats until they are few enough for one thread: nothing is allocated.
    fn fan<L: Lane>(
        self,
        seats: &mut [Seat<L>],
        actions: &[f32],
        mut rows: Rows<'_>,
    ) -> Result<(), BatchError> {
        let width = self.shape.agents * self.shape.action;
        if seats.len() <= self.chunk {
            // Whatever happens to one, the others step: what has moved must not depend on who shares a thread with whom.
            let mut first = Ok(());
            for (seat, (actions, row)) in
                seats.iter_mut().zip(actions.chunks_exact(width).zip(rows.rows(self.shape)))
            {
                let stepped = seat.step(self.feed, self.autoreset, actions, row);
                first = first.and(stepped);
            }
            return first;
        }
        let half = seats.len() / 2;
        let (seats, others) = seats.split_at_mut(half);
        let (actions, other_actions) = actions.split_at(half * width);
        let head = rows.split(half, self.shape);
        let (a, b) = rayon::join(|| self.fan(seats, actions, head), || self.fan(others, other_actions, rows));
        a.and(b)
    }
}

impl<L: Lane> Batch for Engine<L> {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn reset(&mut self, mask: Option<&[bool]>, observations: &mut [f32]) -> Result<(), BatchError> {
        let Shape { envs, .. } = self.shape;
        let size = |buffer, found, wanted| {
            if found == wanted { Ok(()) } else { Err(BatchError::Size { buffer, found, wanted }) }
        };
        size("mask", mask.map_or(envs, <[bool]>::len), envs)?;
        self.each(observations, |feed, seat, row| {
            if mask.is_none_or(|mask| mask[seat.slot]) {
                seat.restart(feed)?;
                seat.observe(row);
            }
            Ok(())
        })
    }

    fn observe(&mut self, observations: &mut [f32]) -> Result<(), BatchError> {
        self.each(observations, |_, seat, row| {
            seat.observe(row);
            Ok(())
        })
    }

    fn step(&mut self, actions: &[f32], out: Output<'_>) -> Result<(), BatchError> {
        self.check(actions, &out)?;
        let (shape, autoreset, feed) = (self.shape, self.autoreset, &*self.feed);
        let rows = Rows::from(out);
        let flight = Flight { feed, autoreset, shape, chunk: self.chunk() };
        flight.fan(&mut self.seats, actions, rows)
    }

    fn episode(&self, env: usize) -> Option<(Scenario, f64)> {
        let seat = self.seats.get(env)?;
        let (recipe, seed) = seat.flies.as_ref()?;
        Some((Scenario::new(Arc::clone(recipe), *seed), seat.lane.score()))
    }

    fn state_hash(&self, env: usize) -> Option<[u8; 32]> {
        self.seats.get(env).map(|seat| seat.lane.state_hash())
    }

    fn scene(&self, env: usize, acted: &[f32]) -> Option<Scene> {
        let seat = self.seats.get(env)?;
        seat.flies.as_ref().map(|_| seat.lane.scene(acted))
    }

    fn telemetry(&self, env: usize) -> Option<Value> {
        let seat = self.seats.get(env)?;
        seat.flies.as_ref().map(|_| seat.lane.telemetry())
    }

    fn alerts(&self, env: usize) -> Vec<String> {
        self.seats.get(env).map(|seat| seat.lane.alerts()).unwrap_or_default()
    }

    fn absent(&self, env: usize, terminated: &mut [bool]) {
        match self.seats.get(env) {
            Some(seat) if !seat.rests => seat.lane.absent(terminated),
            _ => terminated.fill(true),
        }
    }

    fn rests(&self, env: usize) -> bool {
        self.seats.get(env).is_some_and(|seat| seat.rests)
    }

    fn columns(&self) -> Vec<String> {
        self.seats.first().map(|seat| seat.lane.columns()).unwrap_or_default()
    }

    fn bytes_per_env(&self) -> usize {
        let lanes: usize = self.seats.iter().map(|seat| seat.lane.bytes() + size_of::<Seat<L>>()).sum();
        lanes / self.seats.len().max(1)
    }
}
