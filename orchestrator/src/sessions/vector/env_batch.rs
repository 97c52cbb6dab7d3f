//! [`EnvBatch`]: the environments of a vector session, and the reply frames that they write.

use std::sync::Arc;

use axum::body::Bytes;
use env_core::batch::{Batch, BatchError, BatchOutput};

use super::assigner::LeaseAssigner;
use super::frame::{FrameCommand, FrameLayout, HEADER_BYTES, padded};

/// Flag of an environment whose episode ended in this step.
pub const FLAG_DONE: u8 = 1;
/// Flag of an environment that rests because its lease has no free episode.
pub const FLAG_IDLE: u8 = 2;

/// Environments with their buffers.
pub(crate) struct EnvBatch {
    batch: Box<dyn Batch>,
    layout: FrameLayout,
    /// Assigner of the lease's episodes; `None` without a lease.
    pub(super) assigner: Option<LeaseAssigner>,
    actions: Vec<f32>,
    final_observations: Vec<f32>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
    needs_action: Vec<bool>,
    done: Vec<bool>,
    /// Buffer of the frame before the last one, reused for the next frame if no reader holds it.
    spare: Arc<Vec<f32>>,
    /// Buffer of the last frame.
    current: Arc<Vec<f32>>,
}

/// Bytes of a frame, which share the buffer of the batch.
struct FrameBytes {
    buffer: Arc<Vec<f32>>,
    len: usize,
}

impl AsRef<[u8]> for FrameBytes {
    fn as_ref(&self) -> &[u8] {
        let bytes: &[u8] = bytemuck::cast_slice(&self.buffer);
        &bytes[..self.len.min(bytes.len())]
    }
}

/// Parts of a reply frame in its buffer.
struct ReplyParts<'a> {
    header: &'a mut [f32],
    observations: &'a mut [f32],
    rewards: &'a mut [f32],
    team_rewards: &'a mut [f32],
    elapsed: &'a mut [f32],
    /// Episode indices, flags and final observations, as bytes.
    rest: &'a mut [f32],
}

impl<'a> ReplyParts<'a> {
    fn split(buffer: &'a mut [f32], layout: FrameLayout) -> Self {
        let FrameLayout { envs, agents, observation, .. } = layout;
        let (header, buffer) = buffer.split_at_mut(HEADER_BYTES / 4);
        let (observations, buffer) = buffer.split_at_mut(envs * observation);
        let (rewards, buffer) = buffer.split_at_mut(envs * agents);
        let (team_rewards, buffer) = buffer.split_at_mut(envs);
        let (elapsed, rest) = buffer.split_at_mut(envs);
        Self { header, observations, rewards, team_rewards, elapsed, rest }
    }
}

impl EnvBatch {
    /// Creates the buffers of a batch. The environments are not reset yet.
    pub(crate) fn new(batch: Box<dyn Batch>, layout: FrameLayout, assigner: Option<LeaseAssigner>) -> Self {
        let FrameLayout { envs, agents, action, observation, has_finals, .. } = layout;
        let buffer = || Arc::new(vec![0.0; layout.max_reply_bytes() / 4]);
        Self {
            batch,
            layout,
            assigner,
            actions: vec![0.0; envs * agents * action],
            final_observations: vec![0.0; if has_finals { envs * observation } else { 0 }],
            terminated: vec![false; envs * agents],
            truncated: vec![false; envs * agents],
            needs_action: vec![true; envs * agents],
            done: vec![false; envs],
            spare: buffer(),
            current: buffer(),
        }
    }

    /// Returns the bytes that the buffers of a batch with this layout need, with the copies in the socket.
    pub(crate) fn buffer_bytes(layout: FrameLayout) -> usize {
        let finals = if layout.has_finals { layout.envs * layout.observation * 4 } else { 0 };
        // Two replies here and one on its way through the socket; the client's actions and their copy.
        3 * layout.max_reply_bytes()
            + finals
            + 2 * layout.actions_bytes()
            + layout.envs * (layout.agents * 3 + 1)
    }

    /// Returns the names of the values of an observation.
    pub(crate) fn columns(&self) -> Vec<String> {
        self.batch.columns()
    }

    /// Runs a client's command and returns the reply frame.
    pub(super) fn run(&mut self, sequence: u32, command: FrameCommand<'_>) -> Result<Bytes, BatchError> {
        match command {
            FrameCommand::Step(bytes) => {
                let (cells, _) = bytes.as_chunks::<4>();
                for (action, cell) in self.actions.iter_mut().zip(cells) {
                    *action = f32::from_le_bytes(*cell);
                }
                self.step(sequence)
            }
            FrameCommand::Reset(mask) => {
                let mask: Vec<bool> = mask.iter().map(|&byte| byte != 0).collect();
                self.reset(sequence, Some(&mask))
            }
        }
    }

    /// Starts new episodes in all environments, or in those of a mask.
    pub(crate) fn reset(&mut self, sequence: u32, mask: Option<&[bool]>) -> Result<Bytes, BatchError> {
        if let Some(assigner) = &mut self.assigner {
            assigner.give_up(mask);
            assigner.assign_for_reset(mask);
        }
        let mut buffer = self.next_buffer();
        let current = Arc::clone(&self.current);
        let cells = Arc::get_mut(&mut buffer).map(Vec::as_mut_slice).unwrap_or_default();
        cells.copy_from_slice(&current); // other environments keep their last observation
        let parts = ReplyParts::split(cells, self.layout);
        if let Err(error) = self.batch.reset(mask, parts.observations) {
            self.spare = buffer;
            return Err(error);
        }
        parts.rewards.fill(0.0);
        parts.team_rewards.fill(0.0);
        parts.elapsed.fill(0.0);
        self.truncated.fill(false);
        self.done.fill(false);
        let agents = self.layout.agents;
        for (env, terminated) in self.terminated.chunks_exact_mut(agents).enumerate() {
            if mask.is_none_or(|mask| mask[env]) {
                self.batch.mark_absent_agents(env, terminated);
                let needs_action = &mut self.needs_action[env * agents..(env + 1) * agents];
                self.batch.write_needs_action(env, needs_action);
            }
        }
        if let Some(assigner) = &mut self.assigner {
            assigner.record_reset(mask);
        }
        Ok(self.finish_reply(sequence, buffer))
    }

    fn step(&mut self, sequence: u32) -> Result<Bytes, BatchError> {
        if let Some(assigner) = &mut self.assigner {
            assigner.assign_for_step();
        }
        let mut buffer = self.next_buffer();
        // `next_buffer` returns a buffer without other references.
        let cells = Arc::get_mut(&mut buffer).map(Vec::as_mut_slice).unwrap_or_default();
        let parts = ReplyParts::split(cells, self.layout);
        let stepped = self.batch.step(
            &self.actions,
            BatchOutput {
                observations: &mut *parts.observations,
                final_observations: &mut self.final_observations,
                rewards: &mut *parts.rewards,
                team_rewards: &mut *parts.team_rewards,
                terminated: &mut self.terminated,
                truncated: &mut self.truncated,
                done: &mut self.done,
                elapsed: &mut *parts.elapsed,
                needs_action: &mut self.needs_action,
                executed_actions: &mut [],
            },
        );
        if let Err(error) = stepped {
            self.spare = buffer;
            return Err(error);
        }
        if let Some(assigner) = &mut self.assigner {
            assigner.record_step(&self.actions, parts.team_rewards, &self.done);
        }
        Ok(self.finish_reply(sequence, buffer))
    }

    /// Takes the spare buffer, or a new one if a reader still holds it.
    fn next_buffer(&mut self) -> Arc<Vec<f32>> {
        let mut buffer = std::mem::take(&mut self.spare);
        if Arc::get_mut(&mut buffer).is_none_or(|cells| cells.is_empty()) {
            buffer = Arc::new(vec![0.0; self.layout.max_reply_bytes() / 4]);
        }
        buffer
    }

    /// Writes the header, episodes, flags and final observations, and returns the frame.
    fn finish_reply(&mut self, sequence: u32, mut buffer: Arc<Vec<f32>>) -> Bytes {
        let layout = self.layout;
        let envs = layout.envs;
        let cells = Arc::get_mut(&mut buffer).map(Vec::as_mut_slice).unwrap_or_default();
        let parts = ReplyParts::split(cells, layout);
        bytemuck::cast_slice_mut(parts.header).copy_from_slice(&layout.reply_header(sequence));
        let mut rest: &mut [u8] = bytemuck::cast_slice_mut(parts.rest);
        if let Some(assigner) = &self.assigner {
            let cells = take_padded(&mut rest, envs * 4).as_chunks_mut::<4>().0;
            for (index, cell) in assigner.episode_indices().zip(cells) {
                *cell = index.to_le_bytes();
            }
        }
        for flags in [&self.terminated, &self.truncated, &self.needs_action] {
            take_padded(&mut rest, flags.len())[..flags.len()].copy_from_slice(bytemuck::cast_slice(flags));
        }
        for (env, flags) in take_padded(&mut rest, envs)[..envs].iter_mut().enumerate() {
            let idle = if self.batch.is_idle(env) { FLAG_IDLE } else { 0 };
            *flags = if self.done[env] { FLAG_DONE | idle } else { idle };
        }
        let mut len = layout.reply_bytes();
        if layout.has_finals {
            let rows = self.final_observations.chunks_exact(layout.observation).zip(&self.done);
            for (row, _) in rows.filter(|(_, done)| **done) {
                let width = layout.observation * 4;
                let cells = take_padded(&mut rest, width).as_chunks_mut::<4>().0;
                for (cell, value) in cells.iter_mut().zip(row) {
                    *cell = value.to_le_bytes();
                }
                len += width;
            }
        }
        self.spare = std::mem::replace(&mut self.current, buffer);
        Bytes::from_owner(FrameBytes { buffer: Arc::clone(&self.current), len })
    }
}

/// Splits off the first `bytes` of a slice with their padding; the slice keeps the rest.
fn take_padded<'a>(slice: &mut &'a mut [u8], bytes: usize) -> &'a mut [u8] {
    let whole = std::mem::take(slice);
    let (head, tail) = whole.split_at_mut(padded(bytes).min(whole.len()));
    *slice = tail;
    head
}
