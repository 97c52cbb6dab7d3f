//! The environments of a vector session and the frames that they write.

use std::sync::Arc;

use axum::body::Bytes;
use env_core::batch::{Batch, BatchError, Output};

use super::book::Book;
use super::frame::{HEADER, Layout, What};

/// Bit of an environment's flags: its episode ended in this step.
pub const DONE: u8 = 1;
/// Bit of an environment's flags: there is nothing left for it to fly.
pub const IDLE: u8 = 2;

/// Environments, and what they are stepped with.
pub(super) struct Flock {
    pub(super) batch: Box<dyn Batch>,
    pub(super) layout: Layout,
    /// What is flown of a lease.
    pub(super) book: Option<Book>,
    actions: Vec<f32>,
    finals: Vec<f32>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
    done: Vec<bool>,
    /// The frame before the last one: the next is written where it was, once nobody reads it any more.
    spare: Arc<Vec<f32>>,
    current: Arc<Vec<f32>>,
}

/// A frame that is being sent, or is kept to be sent again.
struct Sent {
    words: Arc<Vec<f32>>,
    bytes: usize,
}

impl AsRef<[u8]> for Sent {
    fn as_ref(&self) -> &[u8] {
        let bytes: &[u8] = bytemuck::cast_slice(&self.words);
        &bytes[..self.bytes.min(bytes.len())]
    }
}

/// The parts of a frame of answers, still to be written.
struct Parts<'a> {
    head: &'a mut [f32],
    observations: &'a mut [f32],
    rewards: &'a mut [f32],
    team_rewards: &'a mut [f32],
    /// Episodes and bytes.
    rest: &'a mut [f32],
}

impl<'a> Parts<'a> {
    fn of(words: &'a mut [f32], layout: Layout) -> Self {
        let Layout { envs, agents, observation, .. } = layout;
        let (head, words) = words.split_at_mut(HEADER / 4);
        let (observations, words) = words.split_at_mut(envs * observation);
        let (rewards, words) = words.split_at_mut(envs * agents);
        let (team_rewards, rest) = words.split_at_mut(envs);
        Self { head, observations, rewards, team_rewards, rest }
    }
}

impl Flock {
    pub(super) fn new(batch: Box<dyn Batch>, layout: Layout, book: Option<Book>) -> Self {
        let Layout { envs, agents, action, observation, finals, .. } = layout;
        let words = || Arc::new(vec![0.0; layout.most_bytes() / 4]);
        Self {
            batch,
            layout,
            book,
            actions: vec![0.0; envs * agents * action],
            finals: vec![0.0; if finals { envs * observation } else { 0 }],
            terminated: vec![false; envs * agents],
            truncated: vec![false; envs * agents],
            done: vec![false; envs],
            spare: words(),
            current: words(),
        }
    }

    /// Bytes of its buffers.
    pub(super) fn bytes(layout: Layout) -> usize {
        let finals = if layout.finals { layout.envs * layout.observation * 4 } else { 0 };
        // Two frames here, one on its way through the socket, the client's, the actions.
        3 * layout.most_bytes() + finals + 2 * layout.actions_bytes() + layout.envs * (layout.agents * 2 + 1)
    }

    /// Does what a client asks; the frame that answers it.
    pub(super) fn answer(&mut self, sequence: u32, what: What<'_>) -> Result<Bytes, BatchError> {
        match what {
            What::Act(bytes) => {
                let (cells, _) = bytes.as_chunks::<4>();
                for (action, cell) in self.actions.iter_mut().zip(cells) {
                    *action = f32::from_le_bytes(*cell);
                }
                self.step(sequence)
            }
            What::Reset(mask) => {
                let mask: Vec<bool> = mask.iter().map(|&byte| byte != 0).collect();
                self.reset(sequence, Some(&mask))
            }
        }
    }

    /// Where the next frame is written.
    fn room(&mut self) -> Arc<Vec<f32>> {
        let mut words = std::mem::take(&mut self.spare);
        if Arc::get_mut(&mut words).is_none_or(|words| words.is_empty()) {
            words = Arc::new(vec![0.0; self.layout.most_bytes() / 4]);
        }
        words
    }

    fn step(&mut self, sequence: u32) -> Result<Bytes, BatchError> {
        if let Some(book) = &mut self.book {
            book.assign(None);
        }
        let mut room = self.room();
        // It was just found to be ours alone.
        let words = Arc::get_mut(&mut room).map(Vec::as_mut_slice).unwrap_or_default();
        let parts = Parts::of(words, self.layout);
        let stepped = self.batch.step(
            &self.actions,
            Output {
                observations: &mut *parts.observations,
                final_observations: &mut self.finals,
                rewards: &mut *parts.rewards,
                team_rewards: &mut *parts.team_rewards,
                terminated: &mut self.terminated,
                truncated: &mut self.truncated,
                done: &mut self.done,
                taken: &mut [],
            },
        );
        if let Err(error) = stepped {
            self.spare = room;
            return Err(error);
        }
        if let Some(book) = &mut self.book {
            book.stepped(&self.actions, parts.team_rewards, &self.done);
        }
        Ok(self.finish(sequence, room))
    }

    /// Lets episodes begin: of all, or of those that are said.
    pub(super) fn reset(&mut self, sequence: u32, mask: Option<&[bool]>) -> Result<Bytes, BatchError> {
        if let Some(book) = &mut self.book {
            book.give_up(mask);
            book.assign(Some(mask));
        }
        let mut room = self.room();
        let current = Arc::clone(&self.current);
        let words = Arc::get_mut(&mut room).map(Vec::as_mut_slice).unwrap_or_default();
        words.copy_from_slice(&current); // who is not reset is seen as it was
        let parts = Parts::of(words, self.layout);
        let begun = self.batch.reset(mask, parts.observations);
        if let Err(error) = begun {
            self.spare = room;
            return Err(error);
        }
        parts.rewards.fill(0.0);
        parts.team_rewards.fill(0.0);
        for buffer in [&mut self.truncated, &mut self.done] {
            buffer.fill(false);
        }
        let agents = self.layout.agents;
        for (env, terminated) in self.terminated.chunks_exact_mut(agents).enumerate() {
            if mask.is_none_or(|mask| mask[env]) {
                self.batch.absent(env, terminated);
            }
        }
        if let Some(book) = &mut self.book {
            book.began(mask);
        }
        Ok(self.finish(sequence, room))
    }

    /// Writes what is not written yet.
    fn finish(&mut self, sequence: u32, mut room: Arc<Vec<f32>>) -> Bytes {
        let layout = self.layout;
        let envs = layout.envs;
        let words = Arc::get_mut(&mut room).map(Vec::as_mut_slice).unwrap_or_default();
        let parts = Parts::of(words, layout);
        bytemuck::cast_slice_mut(parts.head).copy_from_slice(&layout.head(sequence));
        let mut rest: &mut [u8] = bytemuck::cast_slice_mut(parts.rest);
        if let Some(book) = &self.book {
            for (episode, cell) in book.episodes().zip(take(&mut rest, envs * 4).as_chunks_mut::<4>().0) {
                *cell = episode.to_le_bytes();
            }
        }
        for bools in [&self.terminated, &self.truncated] {
            take(&mut rest, bools.len())[..bools.len()].copy_from_slice(bytemuck::cast_slice(bools));
        }
        for (env, flags) in take(&mut rest, envs)[..envs].iter_mut().enumerate() {
            let idle = if self.batch.rests(env) { IDLE } else { 0 };
            *flags = if self.done[env] { DONE | idle } else { idle };
        }
        let mut bytes = layout.stepped_bytes();
        if layout.finals {
            let rows =
                self.finals.chunks_exact(layout.observation).zip(&self.done).filter(|(_, done)| **done);
            for (row, _) in rows {
                let width = layout.observation * 4;
                for (cell, value) in take(&mut rest, width).as_chunks_mut::<4>().0.iter_mut().zip(row) {
                    *cell = value.to_le_bytes();
                }
                bytes += width;
            }
        }
        self.spare = std::mem::replace(&mut self.current, room);
        Bytes::from_owner(Sent { words: Arc::clone(&self.current), bytes })
    }
}

/// The first `bytes` of a slice and what pads them; what is left stays in it.
fn take<'a>(slice: &mut &'a mut [u8], bytes: usize) -> &'a mut [u8] {
    let whole = std::mem::take(slice);
    let (head, tail) = whole.split_at_mut(super::frame::padded(bytes).min(whole.len()));
    *slice = tail;
    head
}
